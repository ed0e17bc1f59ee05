# SPDX-License-Identifier: GPL-3.0-or-later
"""The sequences of a preset, each made when it is needed and removed after, with the bytes that `generate` makes."""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any

from ...core.datasets.layouts import find_sequence
from ...core.datasets.provenance import plain_identity
from ...core.errors import InputError
from ...core.perturbing.steps import Setting
from ...core.planning.plan import Plan, Render, lay_out_plan, read_settings
from ...core.planning.sequence import lay_out
from ...core.planning.source import Scene, Source
from ...core.presets.preset import Preset, check_document
from ...core.progress import Progress
from ...perturbations import registry
from ...pipeline.run import Run
from ...pipeline.versions import versions_of
from ...recipes.opening import open_path
from ...sources import find_scenes
from .cases import Case, Condition
from .clean_sequence import CleanSequence
from .kept_frames import KeptFrames, KeptSource, frames_bytes
from .notes import NotesOnly
from .origin import CaseSequence
from .repeating import depends_on_seed
from .results import ResultsFolder
from .scene_cache import CachedSource, SceneCache


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
        self._holder = SceneCache()

    @cached_property
    def whole(self) -> Plan:
        """The plan of all sequences of one seed."""
        return lay_out_plan(self.preset, tuple(self._settings.values()), tuple(self._scenes.values()))

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
        kept = [scene for scene in self._scenes.values() if scene.source.gives.rendered]
        seeds = len(self.seeds) if self.renders_by_seed else 1
        return max(
            (seeds * frames_bytes(self.whole.cameras[scene.name], scene.frame_count) for scene in kept), default=0
        )

    @property
    def renders_by_seed(self) -> bool:
        """Whether clean frames follow the seed: Blender's samples do."""
        return self.whole.renders_in_blender

    @property
    def frames(self) -> Mapping[Case, int]:
        """The cases, scene by scene: settings that no seed changes have the first one only."""
        return self._frames

    @cached_property
    def _frames(self) -> Mapping[Case, int]:
        found: dict[Case, int] = {}
        for scene in self._scenes.values():
            for seed in self.seeds:
                for setting in self._settings.values():
                    if seed == self.seeds[0] or self._varies(setting, scene, seed):
                        laid = lay_out(setting, scene.name, scene.frame_count, (seed, scene.name, setting.name))
                        found[Case(scene.name, setting.name, seed)] = len(laid.frames)
        return found

    def _varies(self, setting: Setting, scene: Scene, seed: int) -> bool:
        """Tell whether a sequence with a seed is another than that with the first one."""
        by_seed = scene.source.gives.rendered and self.renders_by_seed
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
        Run(plan, folder, progress=NotesOnly(progress, case.scene), stop=self._stop).make_dataset()
        (render,) = plan.renders
        (sequence,) = render.sequences
        opened = open_path(folder)[sequence.folder]
        place = folder / sequence.folder
        changed = bool(sequence.setting.rgb or sequence.setting.depth or sequence.paired)
        clean = CleanSequence(opened, sequence, kept, plan.format) if changed and kept is not None else None
        mesh = self._scenes[case.scene].source.mesh
        yield CaseSequence(place, find_sequence(place).trajectory, opened, clean, mesh)
        if render.moving and kept is not None:
            self._results.remove(kept.folder)
        if not self._keep:
            self._results.remove(folder)

    def finished(self, scene: str) -> None:
        """Remove the clean frames of a scene, and let go of it."""
        self._holder.close()
        self._results.remove(self._results.clean_frames(scene))

    def _plan(self, case: Case) -> tuple[Plan, KeptFrames | None]:
        """Return the plan of a case's sequence alone, with where its clean frames are kept."""
        preset = _with_seed(self.preset, case.seed)
        setting, scene = self._settings[case.setting], self._scenes[case.scene]
        plan = lay_out_plan(preset, (setting,), [scene])
        (render,) = plan.renders
        kept = self._kept(render, case)
        source: Source = CachedSource(scene.source, scene.name, self._holder, self.renders_by_seed)
        scene = replace(scene, source=source if kept is None else KeptSource(source, kept))
        return replace(plan, renders=(replace(render, scene=scene),)), kept

    def _kept(self, render: Render, case: Case) -> KeptFrames | None:
        if not (self._keep_clean and render.scene.source.gives.rendered):
            return None
        folder = self._results.clean_frames(case.scene)
        if render.moving:  # for this case alone
            return KeptFrames(folder / f"{case.setting}@{case.seed}") if _images_changed(render) else None
        return KeptFrames(folder / (f"seed-{case.seed}" if self.renders_by_seed else "all"))


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
