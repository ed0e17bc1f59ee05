# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the sequences of a study come from: made of a preset one by one, or found in a folder."""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import COLOUR_AND_DEPTH
from ..core.atomic_files import sha256_of_bytes
from ..core.errors import InputError, PresetKey
from ..core.file_access import canonical
from ..core.geometry import Intrinsics
from ..core.lens import Distortion
from ..core.progress import Progress, SilentProgress
from ..core.schema import ConfigPath
from ..core.trajectory import Trajectory
from ..dataset.clean_store import CleanFiles, frames_bytes
from ..dataset.folder_state import clean_identity, read_dataset_state
from ..dataset.frame import Camera, CleanFrame, CleanFrames, PlannedFrame
from ..dataset.identity import path_sha256, plain_identity, versions_of
from ..dataset.loader import Frame, OpenedFolder, OpenedSequence, SequenceOfFiles
from ..dataset.making import FrameMaker, KeptScene
from ..dataset.opening import open_path
from ..dataset.plan import Plan, Render, lay_out_plan, read_settings
from ..dataset.recipe import FrameNumbers
from ..dataset.rendering import render_options
from ..dataset.run import Run
from ..dataset.sequence import PlannedSequence, lay_out
from ..layouts import OutputFormat, find_sequence
from ..perturbations import registry
from ..perturbations.execution import move, split_motion
from ..perturbations.kinds import Identifiers
from ..perturbations.steps import Setting
from ..preset.keys import Preset, check_document
from ..preset.names import selected
from ..render.source import RenderedFrame
from ..scenes.polygon_mesh import Mesh
from ..sources import find_scenes
from ..sources.scene_kinds import Scene
from .cases import CLEAN, RECORDED, Case, Condition
from .study_results import ResultsFolder


@dataclass(frozen=True)
class CaseSequence:
    """The sequence of a case, on the disk.

    folder: where it lies. truth: the colour camera's poses, one for each frame. opened: its frames. clean: the frames
    that it would have without what was done to colour, depth and their pairing; None where nothing was, or they are not
    there. mesh: returns what the true scene is; None where nobody knows.
    """

    folder: Path
    truth: Trajectory
    opened: OpenedSequence
    clean: OpenedSequence | None
    mesh: Callable[[], Mesh] | None = None


# The sequences of a folder: a dataset of Noisy World, or recordings with ground truth. Nothing is made or removed.


class FolderOrigin:
    """The sequences of a folder. What a setting is follows from the dataset's manifest, or else from its name."""

    def __init__(self, folder: Path, scenes: Sequence[str] = (), settings: Sequence[str] = ()) -> None:
        """Find the sequences. scenes, settings: names or globs of those that are wanted, if not all.

        Raises InputError where there is none, and where the folder holds sequences in tars.
        """
        opened = open_path(folder)
        if not isinstance(opened, OpenedFolder):
            raise InputError(folder, "holds sequences in tars, and systems read files", remedy="unpack them")
        self._opened = opened
        state = read_dataset_state(folder)
        self._made_from = None if state is None else state.identity
        seed = 0 if self._made_from is None else int(self._made_from["seed"])
        self._names = {_case(name, seed): name for name in opened}
        if len(self._names) < len(opened):
            raise InputError(folder, "holds two sequences of one name", remedy="name one of the folders in it")
        of_scenes = self._wanted("scene", scenes)
        of_settings = self._wanted("setting", settings)
        self._names = {
            case: name for case, name in self._names.items() if case.scene in of_scenes and case.setting in of_settings
        }
        if not self._names:
            raise InputError(folder, "holds none of these scenes in any of these settings")

    def _wanted(self, what: Literal["scene", "setting"], globs: Sequence[str]) -> set[str]:
        """Return the scenes or settings that are wanted. Raises InputError where a glob matches none."""
        names = list(dict.fromkeys(getattr(case, what) for case in self._names))
        return set(selected(names, list(globs) or None, ConfigPath(self._opened.place).at(f"{what}s")))

    @property
    def identity(self) -> dict[str, Any]:
        """The sequences with what their frames and true poses are known by; and what the dataset was made from."""
        return {
            "found": {case.name: self._known_by(case) for case in sorted(self._names)},
            "settings": self._settings,
        }

    def _known_by(self, case: Case) -> dict[str, Any]:
        truth = self._sequence(case).stored.trajectory
        return {"frames": len(truth), "sha256": path_sha256(truth, truth.stamps_s, len(truth))}

    @property
    def _settings(self) -> dict[str, Any]:
        known = {} if self._made_from is None else self._made_from["settings"]
        return {case.setting: known[case.setting] for case in sorted(self._names) if case.setting in known}

    @property
    def frames(self) -> Mapping[Case, int]:
        """The cases, scene by scene, their settings by name; the clean one of a scene is the first."""
        ordered = sorted(self._names, key=lambda case: (case.scene, case.setting != CLEAN))
        return {case: len(self._opened[self._names[case]]) for case in ordered}

    def condition(self, setting: str) -> Condition:
        """Return what is done in a setting: of one that no manifest tells of, its name."""
        if setting in self._settings:
            return Condition.of(self._settings[setting], registry())
        return Condition.of_name(setting)

    @contextmanager
    def sequence(self, case: Case, progress: Progress) -> Iterator[CaseSequence]:
        """Return the sequence of a case."""
        opened = self._sequence(case)
        for note in opened.stored.notes:
            progress.note(f"{case.scene}: {note}", case.name)
        yield CaseSequence(opened.stored.folder, opened.stored.trajectory, opened, self._clean(case, opened))

    def _clean(self, case: Case, opened: SequenceOfFiles) -> SequenceOfFiles | None:
        """Return the clean sequence of the scene, where each of its frames is seen from where the case's is."""
        other = Case(case.scene, CLEAN, case.seed)
        if case.setting == CLEAN or other not in self._names:
            return None
        clean = self._sequence(other)
        same = np.array_equal(clean.stored.trajectory.c2w, opened.stored.trajectory.c2w)
        return clean if same and list(clean.frames) == list(opened.frames) else None

    def _sequence(self, case: Case) -> SequenceOfFiles:
        opened = self._opened[self._names[case]]
        assert isinstance(opened, SequenceOfFiles), "a folder's sequences are files"
        return opened

    def finished(self, scene: str) -> None:
        """Do nothing: nothing was kept."""
        del scene


def _case(name: str, seed: int) -> Case:
    *above, scene = name.split("/")
    return Case(scene, above[-1] if above else RECORDED, seed)


# A sequence without what was done to its colour, its depth and their pairing: the clean frames on the same path.


class CleanSequence(OpenedSequence):
    """The clean counterpart of a sequence: frame i shows what that of the sequence shows."""

    def __init__(
        self, noisy: OpenedSequence, laid: PlannedSequence, read: Callable[[int], CleanFrame], format_: OutputFormat
    ) -> None:
        """Take the sequence and how it was laid out. read: returns the frame on the path with a number, kept or made.

        format_: in whose steps depth is.
        """
        self.name = f"{noisy.name} without noise"
        self._noisy = noisy
        self._laid = laid
        self.read = lru_cache(maxsize=1)(read)  # colour and depth of a frame are asked for one after another
        self.format = format_

    @property
    def frames(self) -> FrameNumbers:
        """Those of the sequence."""
        return self._noisy.frames

    @property
    def camera(self) -> Intrinsics | None:
        """The sequence's."""
        return self._noisy.camera

    @property
    def distortion(self) -> Distortion | None:
        """The sequence's."""
        return self._noisy.distortion

    def _frame(self, index: int) -> "CleanCounterpart":
        return CleanCounterpart(self, self._noisy[index], self._laid.source_frames[index])


class CleanCounterpart(Frame):
    """A clean frame: colour, and the depth of the same moment."""

    def __init__(self, made_in: CleanSequence, noisy: Frame, source: int) -> None:
        """Take the frame as it is in the sequence. source: the frame on the path that it shows."""
        self.sequence = made_in.name
        self.index = noisy.index
        self.stamp_s = self.depth_stamp_s = noisy.stamp_s
        self.c2w = noisy.c2w
        self._in = made_in
        self._source = source

    @property
    def _clean(self) -> CleanFrame:
        return self._in.read(self._source)

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB, not encoded."""
        return self._clean.byte_rgb

    @property
    def rgb_uncompressed(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB."""
        return self.rgb

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void, in the steps of the dataset's files."""
        return self._in.format.stored_depth_m(self._clean.depth_m)

    def _other(self, channel: str) -> NDArray[Any]:
        return self._clean.image(channel)

    @property
    def done(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def image_bytes(self, channel: str) -> bytes:
        """Raise InputError: it is in no dataset."""
        problem = f"its {channel} is in no file of a dataset"
        raise InputError(self._in.name, problem, remedy="take the image itself")


# Progress of a study: notes of its sequences are passed on, their own progress is not.


class NotesOnly(Progress):
    """A listener that hands on notes on a scene alone."""

    def __init__(self, progress: Progress, scene: str) -> None:
        """Take who hears them."""
        self._progress = progress
        self._scene = scene

    def note(self, text: str, subject: str = "") -> None:
        """Hand on a sentence on the scene: what concerns the sequence's files, nobody sees."""
        if text.startswith(self._scene):
            self._progress.note(text, subject or text)


# Which settings are the same whatever the seed, so that one seed is enough: found by trying it.


PROBED_FRAMES = 12  # of which a severity that is drawn differs somewhere but in one of 10^8 cases
PROBE_PX = (64, 48)


def depends_on_seed(setting: Setting, scene: Scene, seeds: tuple[int, int], *, renders_by_seed: bool) -> bool:
    """Tell whether a sequence is another with another seed.

    Motion and pairing are compared as they are, what is done to images on small ones with edges, near and far, and
    void. renders_by_seed: whether the renderer's samples follow the seed, so that every frame does.
    """
    if renders_by_seed:
        return True
    one, other = ((seed, scene.name, setting.name) for seed in seeds)
    return _motion_differs(setting, scene, one, other) or _images_differ(setting, one, other)


def _motion_differs(setting: Setting, scene: Scene, one: Identifiers, other: Identifiers) -> bool:
    laid = [lay_out(setting, scene.name, scene.frame_count, identifiers) for identifiers in (one, other)]
    if (laid[0].source_frames, laid[0].depth_frames) != (laid[1].source_frames, laid[1].depth_frames):
        return True
    moving, _ = split_motion(setting.motion, exposed=bool(setting.exposure))
    if not moving:
        return False
    path = scene.path
    return not np.array_equal(move(moving, path, one).c2w, move(moving, path, other).c2w)


def _images_differ(setting: Setting, one: Identifiers, other: Identifiers) -> bool:
    if not (setting.rgb or setting.depth):
        return False
    rgb, depth_m = _probe()
    width_px, height_px = PROBE_PX
    camera = Intrinsics(width_px, height_px, width_px, width_px, (width_px - 1) / 2, (height_px - 1) / 2)
    seen = Camera(camera, np.arange(PROBED_FRAMES) / 20)
    clean = CleanFrames(seen, seen).of_one(CleanFrame(0, RenderedFrame(rgb, depth_m)))
    by_reference = Setting(setting.name, (*setting.rgb, *setting.depth))
    laid = [lay_out(by_reference, "", PROBED_FRAMES, identifiers) for identifiers in (one, other)]
    for index in range(PROBED_FRAMES):
        frames = [PlannedFrame(sequence, index, clean) for sequence in laid]
        if not all(_equal(*(frame.changed(channel) for frame in frames)) for channel in COLOUR_AND_DEPTH):
            return True
    return False


def _equal(left: NDArray[np.generic] | None, right: NDArray[np.generic] | None) -> bool:
    if left is None or right is None:
        return left is right
    return np.array_equal(left, right, equal_nan=left.dtype.kind == "f")


def _probe() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return colour (H, W, 3) in [0, 1] and depth (H, W) in metres: ramps with edges, from near to far, and void."""
    width_px, height_px = PROBE_PX
    across, down = np.meshgrid(np.linspace(0, 1, width_px), np.linspace(0, 1, height_px))
    steps = (np.floor(6 * across) + np.floor(4 * down)) % 2
    rgb = np.stack([across, down, 0.25 + 0.5 * steps], axis=-1).astype(np.float32)
    depth_m = (0.2 + 6.0 * across + 1.5 * steps).astype(np.float32)
    depth_m[-4:] = 0.0
    return rgb, depth_m


# The sequences of a preset, each made when it is needed and removed after, with the bytes that `generate` makes.


KEY_DIGITS = 16  # of the hash of what decides a render's frames


class PresetOrigin:
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

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What decides the sequences, but for the seeds: as in a dataset's manifest."""
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

    @cached_property
    def frames(self) -> Mapping[Case, int]:
        """The cases, scene by scene, clean frames first: settings that no seed changes have the first seed only."""
        counts: dict[Case, int] = {}
        clean_first = sorted(self._settings.values(), key=lambda setting: bool(setting.steps))
        for scene in self._scenes.values():
            for seed in self.seeds:
                for setting in clean_first:
                    if seed == self.seeds[0] or self._varies(setting, scene, seed):
                        laid = lay_out(setting, scene.name, scene.frame_count, (seed, scene.name, setting.name))
                        counts[Case(scene.name, setting.name, seed)] = len(laid.frames)
        return counts

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


Origin: TypeAlias = FolderOrigin | PresetOrigin
"""The sequences of a study."""
