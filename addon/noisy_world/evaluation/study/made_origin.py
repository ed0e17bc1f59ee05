# SPDX-License-Identifier: GPL-3.0-or-later
"""The sequences of a preset, each made when it is needed and removed after, with the bytes that `generate` makes."""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

from ...core.datasets.identity_mismatch import clean_identity
from ...core.datasets.layouts import find_sequence
from ...core.datasets.provenance import plain_identity
from ...core.datasets.storage import sha256_of_bytes
from ...core.errors import InputError
from ...core.messages import PresetKey
from ...core.perturbing.steps import Setting
from ...core.planning.exposed import render_options
from ...core.planning.plan import Plan, Render, lay_out_plan, read_settings
from ...core.planning.scene import Scene
from ...core.planning.sequence import lay_out
from ...core.presets.preset import Preset, canonical, check_document
from ...core.progress import Progress, SilentProgress
from ...perturbations import registry
from ...pipeline.clean_files import CleanFiles, frames_bytes
from ...pipeline.frame_maker import FrameMaker, KeptScene
from ...pipeline.run import Run
from ...pipeline.versions import versions_of
from ...recipes.opening import open_path
from ...sources import find_scenes
from .cases import Case, Condition
from .clean_sequence import CleanSequence
from .notes import NotesOnly
from .origin import CaseSequence
from .repeating import depends_on_seed
from .results import ResultsFolder

KEY_DIGITS = 16  # of the hash of what decides a render's frames


class MadeOrigin:
    """The sequences of a preset.

    A scene's path is that of the preset's own seed, whatever the seed of a case, unless it is read from a file: seeds
    differ in what is random in the perturbations.
    """

    def __init__(
        self,
        preset: Preset,
        seeds: tuple[int, ...],
        results: ResultsFolder,
        *,
        keep: bool = False,
        keep_clean: bool = True,
        stop: threading.Event | None = None,
    ) -> None:
        """Find the files of the scenes.

        seeds: of the cases; () for the preset's own. keep: whether sequences stay. keep_clean: whether clean frames are
        kept while the settings of a scene are evaluated. stop: ends the making of a sequence.

        Raises InputError.
        """
        pinned = _pinned(preset)
        self.preset = pinned
        self.seeds = seeds or (pinned.spec.seed,)
        self._settings = {setting.name: setting for setting in read_settings(pinned, registry())}
        self._scenes = {scene.name: scene for scene in find_scenes(pinned)}
        self._results = results
        self._keep = keep
        self._keep_clean = keep_clean
        self._stop = stop or threading.Event()
        self._scene = KeptScene()
        self._clean: dict[str, CleanFiles] = {}  # by the name of the folder

    @cached_property
    def whole(self) -> Plan:
        """The plan of all sequences of one seed. Raises InputError where systems would not read them as they are."""
        plan = lay_out_plan(self.preset, tuple(self._settings.values()), tuple(self._scenes.values()))
        _check_read(plan)
        return plan

    @property
    def identity(self) -> dict[str, Any]:
        """What decides the sequences, but for the seeds: as in a dataset's manifest."""
        return self._identity

    @cached_property
    def _identity(self) -> dict[str, Any]:
        return plain_identity(self.whole, versions_of(self.whole))

    @property
    def clean_bytes(self) -> int:
        """How many bytes the clean frames of the largest scene take while it is evaluated; 0 where none are kept."""
        renders = [render for render in self.whole.renders if render.scene.source.capabilities.rendered]
        seeds = len(self.seeds) if self.renders_by_seed else 1
        return seeds * max(
            (
                frames_bytes(render.camera, len(render.frames), render_options(self.whole, render).channels)
                for render in renders
            ),
            default=0,
        )

    @property
    def renders_by_seed(self) -> bool:
        """Whether clean frames follow the seed: Blender's samples do."""
        return self.whole.renders_in_blender

    @property
    def frames(self) -> Mapping[Case, int]:
        """The cases, scene by scene, clean frames first: settings that no seed changes have the first seed only."""
        return self._frames

    @cached_property
    def _frames(self) -> Mapping[Case, int]:
        found: dict[Case, int] = {}
        clean_first = sorted(self._settings.values(), key=lambda setting: bool(setting.steps))
        for scene in self._scenes.values():
            for seed in self.seeds:
                for setting in clean_first:
                    if seed == self.seeds[0] or self._varies(setting, scene, seed):
                        laid = lay_out(setting, scene.name, scene.frame_count, (seed, scene.name, setting.name))
                        found[Case(scene.name, setting.name, seed)] = len(laid.frames)
        return found

    def _varies(self, setting: Setting, scene: Scene, seed: int) -> bool:
        """Tell whether a sequence with a seed is another than that with the first one."""
        by_seed = scene.source.capabilities.rendered and self.renders_by_seed
        return depends_on_seed(setting, scene, (self.seeds[0], seed), renders_by_seed=by_seed)

    def condition(self, setting: str) -> Condition:
        """Return what is done in a setting."""
        return Condition.of(self.identity["settings"][setting], registry())

    @contextmanager
    def sequence(self, case: Case, progress: Progress) -> Iterator[CaseSequence]:
        """Make the sequence of a case. It is removed when the context ends well, unless it is kept.

        Raises InterruptedRunError where `stop` is set; what is made by then stays for the next time.
        """
        plan, kept = self._plan(case)
        folder = self._results.making(case, keep=self._keep)
        (render,) = plan.renders
        heard = NotesOnly(progress, case.scene)
        frames = FrameMaker(plan, progress=heard, stop=self._stop, scene=self._scene, clean=kept)
        Run(plan, folder, progress=heard, stop=self._stop, frames=frames).make_dataset()
        (sequence,) = render.sequences
        opened = open_path(folder)[sequence.folder]
        place = folder / sequence.folder
        changed = bool(sequence.setting.rgb or sequence.setting.depth or sequence.paired)
        mesh = self._scenes[case.scene].source.mesh
        # What is there already, a dataset that is kept for instance, may have no clean frames beside it: they are made.
        with FrameMaker(plan, progress=SilentProgress(), stop=self._stop, scene=self._scene, clean=kept) as maker:
            read = partial(maker.clean_frame, render)
            clean = CleanSequence(opened, sequence, read, plan.format) if changed else None
            yield CaseSequence(place, find_sequence(place).trajectory, opened, clean, mesh)
        if (render.moving or render.exposure) and kept is not None:
            self._clean.pop(kept.folder.name, None)
            self._results.remove(kept.folder)
        if not self._keep:
            self._results.remove(folder)

    def finished(self, scene: str) -> None:
        """Remove the clean frames of a scene, and let go of it."""
        self._scene.close()
        self._clean.clear()
        self._results.remove(self._results.clean_frames(scene))

    def _plan(self, case: Case) -> tuple[Plan, CleanFiles | None]:
        """Return the plan of a case's sequence alone, with where its clean frames are kept."""
        preset = _with_seed(self.preset, case.seed)
        plan = lay_out_plan(preset, (self._settings[case.setting],), [self._scenes[case.scene]])
        return plan, self._kept(plan.renders[0], case)

    def _kept(self, render: Render, case: Case) -> CleanFiles | None:
        own = bool(render.moving or render.exposure)  # for this case alone
        if (
            not self._keep_clean
            or not render.scene.source.capabilities.rendered
            or (own and not _images_changed(render))
        ):
            return None
        made_from = clean_identity(self.identity, case.scene, case.setting if own else "")
        made_from["seed"] = case.seed if own or self.renders_by_seed else None
        name = sha256_of_bytes(canonical(made_from).encode())[:KEY_DIGITS]
        return self._clean.setdefault(
            name, CleanFiles(self._results.clean_frames(case.scene) / name, self._results.work)
        )


def _check_read(plan: Plan) -> None:
    """Raise InputError where a plan makes images that systems do not read, before anything is rendered."""
    preset = plan.preset
    if plan.format.of_light:
        raise preset.place("output.image").error("is exr, light that systems do not read", "name png or jpg")
    for render in plan.renders:
        optics, unit = render.optics, render.unit
        own = optics.depth is not None and unit is not None and unit.camera is not None
        apart = plan.rig is not None and plan.rig.depth is not None and not render.registers
        if own or (apart and plan.format.layout.optics):  # which says so, so that it is read
            place, registered = preset.place("rig.depth"), PresetKey("rig.depth.registered", "true")
            raise place.error("has a camera of its own, and systems read depth in colour's pixels", registered)
        if optics.depth is not None:
            problem = "its depth has a camera of its own, and systems read depth in colour's pixels"
            raise render.scene.error(problem, lacks="registration")
        if optics.distortion is not None:
            rendered = render.scene.source.capabilities.rendered
            remedies = (PresetKey("distortion.undistort", "true"),) if rendered else ()
            problem = "its lens distorts, and systems read a pinhole's images"
            raise render.scene.error(problem, *remedies, lacks="pinhole")


def _images_changed(render: Render) -> bool:
    return any(item.setting.rgb or item.setting.depth or item.paired for item in render.sequences)


def _pinned(preset: Preset) -> Preset:
    """Return a preset whose generated paths have the preset's own seed; without an overview for each sequence.

    Raises InputError where it makes no depth or no colour, or only some of the files that systems read.
    """
    document = dict(preset.document)
    document["scenes"] = [_pinned_scene(scene, preset.spec.seed) for scene in document["scenes"]]
    document["output"] = {**(document.get("output") or {}), "overview": False}
    pinned = check_document(document, preset.path)
    if "rgb" not in pinned.spec.output.format.modalities:
        remedy = "systems read colour; leave the key out"
        raise InputError(preset.path, "lacks rgb", where="output.modalities", remedy=remedy)
    return pinned


def _pinned_scene(scene: Any, seed: int) -> Any:
    path = scene.get("trajectory") if isinstance(scene, dict) else None
    if not isinstance(path, dict):
        return scene
    walked = path.get("handheld")
    if not isinstance(walked, dict) or walked.get("seed") is not None:
        return scene
    return {**scene, "trajectory": {**path, "handheld": {**walked, "seed": seed}}}


def _with_seed(preset: Preset, seed: int) -> Preset:
    return replace(preset, document={**preset.document, "seed": seed}, spec=replace(preset.spec, seed=seed))
