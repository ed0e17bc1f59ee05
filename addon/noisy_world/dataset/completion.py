# SPDX-License-Identifier: GPL-3.0-or-later
"""Completing a dataset whose frames are all there: text files, contact sheet, manifest."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..channels import COLOUR_AND_DEPTH, in_order, surface_channels
from ..core.depth_range import RangeLoss, range_loss
from ..core.errors import Message, PresetKey
from ..core.file_access import canonical, read_bytes
from ..core.frame_request import SensorPaths
from ..core.frame_table import COMPLETED, FrameRecord
from ..core.srgb import encoded
from ..core.trajectory import FrameStamps
from ..images.image_files import read_pixels
from ..images.pixels import decode_light, rgb_bytes
from ..layouts import OutputFormat, SequenceFacts
from ..layouts.asl import imu_texts
from ..layouts.cam_params import stated_optics
from ..layouts.layout import StampsLike
from ..sources.scene_kinds import Scene
from ..trajectories.rig import ImuSamples, RecordedImu, Rig, measure
from .dataset_folder import Dataset
from .folder_state import OVERVIEW
from .frame import motion_of_frames
from .identity import cameras_agree, cameras_of, manifest, optics_of
from .plan import Plan, Render
from .sequence import PlannedSequence, spread, written_paths

# A contact sheet of a dataset: a few frames of each sequence, colour above depth, without repeating what is equal.
#
# Other channels are not on it.


# Chosen, so that the sheet fits a screen's width and its text can be read.
COLUMNS = 5
TILE_WIDTH_PX = 320
GAP_PX = 8
LABEL_PX = 26
MAX_SEQUENCES = 24
BACKGROUND = 24
INK = (225, 225, 225)
VOID_GREY = 60


def draw_overview(
    out: Path, output: OutputFormat, frames: Mapping[str, Sequence[int]], stamps: Mapping[str, StampsLike]
) -> bytes:
    """Draw the contact sheet and return it as PNG.

    out: the dataset. frames: the numbers of the frames of each sequence, by the sequence's folder; the first
    MAX_SEQUENCES are shown. stamps: the time stamps of each scene's frames, by the scene's name. Of a scene's later
    sequences only what differs from the first one is shown. All depths share one colour scale, from the nearest to the
    farthest shown.
    """
    import cv2

    shown = list(_shown(frames).items())
    models = _first_of_scene([folder for folder, _ in shown])
    named = {folder: output.names(stamps[_scene(folder)]) for folder, _ in shown}
    names = {folder: {"rgb": name.rgb, "depth": name.depth} for folder, name in named.items()}
    same = {
        (folder, modality): folder != models[folder]
        and all(
            _same_bytes(out / folder / name, out / models[folder] / name)
            for name in map(names[folder][modality], numbers)
        )
        for folder, numbers in shown
        for modality in in_order(COLOUR_AND_DEPTH.intersection(output.modalities))
    }
    depths_m = {
        folder: [_read_depth(out / folder / named[folder].depth(frame), output) for frame in numbers]
        for folder, numbers in shown
        if same.get((folder, "depth")) is False
    }
    seen_m = np.concatenate([depth_m[depth_m > 0] for row in depths_m.values() for depth_m in row] or [np.zeros(0)])
    near_m, far_m = (float(seen_m.min()), float(seen_m.max())) if seen_m.size else (0.0, 1.0)
    rows = [_legend(near_m, far_m)] if depths_m else []
    for folder, numbers in shown:
        as_there = [word for word, key in (("colour", "rgb"), ("depth", "depth")) if same.get((folder, key))]
        note = f"   ({' and '.join(as_there)} as in {models[folder]})" if as_there else ""
        rows.append(_label(f"{folder}   frames {', '.join(str(number) for number in numbers)}{note}"))
        if same.get((folder, "rgb")) is False:
            rows.append(_row([_read_rgb(out / folder / named[folder].rgb(frame)) for frame in numbers]))
        if folder in depths_m:
            rows.append(_row([colour_depth(depth_m, near_m, far_m) for depth_m in depths_m[folder]]))
    if len(frames) > MAX_SEQUENCES:
        rows.append(_label(f"and {len(frames) - MAX_SEQUENCES} more sequences"))
    _, data = cv2.imencode(".png", np.concatenate(rows)[..., ::-1])
    return data.tobytes()


def _shown(frames: Mapping[str, Sequence[int]]) -> dict[str, list[int]]:
    return {folder: spread(numbers, COLUMNS) for folder, numbers in list(frames.items())[:MAX_SEQUENCES] if numbers}


def needed_frames(frames: Mapping[str, Sequence[int]]) -> dict[str, set[int]]:
    """Return the frames whose images are needed to draw the sheet: those shown, and those that these are compared with.

    frames: the numbers of all, by the sequence's folder.
    """
    shown = _shown(frames)
    needed = {folder: set(numbers) for folder, numbers in shown.items()}
    for folder, model in _first_of_scene(list(shown)).items():
        needed[model] |= set(shown[folder]) & set(frames[model])
    return needed


def _first_of_scene(folders: Sequence[str]) -> dict[str, str]:
    """Return for each sequence (`setting/scene`) the first sequence of its scene."""
    first: dict[str, str] = {}
    return {folder: first.setdefault(_scene(folder), folder) for folder in folders}


def _scene(folder: str) -> str:
    return folder.split("/")[1]


def _same_bytes(path: Path, other: Path) -> bool:
    return other.exists() and (path.samefile(other) or read_bytes(path) == read_bytes(other))


def _read_rgb(path: Path) -> NDArray[np.uint8]:
    import cv2

    if path.suffix == ".exr":
        rgb = _shown_light(path)
    else:
        rgb = np.asarray(read_pixels(path, cv2.IMREAD_COLOR), np.uint8)[..., ::-1]
    tile = cv2.resize(np.ascontiguousarray(rgb), _tile_size(rgb.shape), interpolation=cv2.INTER_AREA)
    return np.asarray(tile, np.uint8)


def _shown_light(path: Path) -> NDArray[np.uint8]:
    """Return light by sRGB's curve, clipped at 1: the scene's own view transform is Blender's alone."""
    return rgb_bytes(encoded(decode_light(read_bytes(path))))


def _read_depth(path: Path, output: OutputFormat) -> NDArray[np.float64]:
    import cv2

    steps = np.asarray(read_pixels(path, cv2.IMREAD_UNCHANGED), np.uint16)
    # Nearest pixel: averaging would make depths between two surfaces, where there is nothing.
    tile = cv2.resize(steps, _tile_size(steps.shape), interpolation=cv2.INTER_NEAREST)
    return np.divide(tile, output.depth_scale_per_m, dtype=np.float64)


def _tile_size(shape: tuple[int, ...]) -> tuple[int, int]:
    return TILE_WIDTH_PX, max(1, round(TILE_WIDTH_PX * shape[0] / shape[1]))


def colour_depth(depth_m: NDArray[np.floating], near_m: float, far_m: float) -> NDArray[np.uint8]:
    """Return planar depth (H, W) in metres, 0 = void, as colours (H, W, 3): from warm, near_m, to cold; void grey."""
    import cv2

    level = np.clip((far_m - depth_m) / max(far_m - near_m, 1e-9), 0, 1)  # near is warm
    picture = cv2.applyColorMap((level * 255).round().astype(np.uint8), cv2.COLORMAP_TURBO)[..., ::-1]
    return np.where((depth_m > 0)[..., None], picture, np.uint8(VOID_GREY))


def _row(tiles: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    height = tiles[0].shape[0]
    row = _blank(height + GAP_PX)
    for column, tile in enumerate(tiles):
        left = GAP_PX + column * (TILE_WIDTH_PX + GAP_PX)
        row[:height, left : left + TILE_WIDTH_PX] = tile
    return row


def _label(text: str) -> NDArray[np.uint8]:
    return _write(_blank(LABEL_PX), text, GAP_PX)


def _legend(near_m: float, far_m: float) -> NDArray[np.uint8]:
    row = _blank(LABEL_PX + GAP_PX)
    bar_px = 200
    ramp_m = np.broadcast_to(np.linspace(near_m, far_m, bar_px), (LABEL_PX - 12, bar_px))
    left = GAP_PX + 190
    row[8 : 8 + ramp_m.shape[0], left : left + bar_px] = colour_depth(ramp_m + 1e-12, near_m, far_m)
    _write(row, f"planar depth  {near_m:.2f} m", GAP_PX)
    return _write(row, f"{far_m:.2f} m   (grey: void)", left + bar_px + GAP_PX)


def _blank(height: int) -> NDArray[np.uint8]:
    return np.full((height, GAP_PX + COLUMNS * (TILE_WIDTH_PX + GAP_PX), 3), BACKGROUND, dtype=np.uint8)


def _write(row: NDArray[np.uint8], text: str, left: int) -> NDArray[np.uint8]:
    import cv2

    cv2.putText(row, text, (left, 19), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    return row


def channel_texts(format_: OutputFormat, scene: Scene) -> dict[str, str]:
    """Return the files of a sequence that say what the values of its channels mean, by name."""
    texts: dict[str, str] = {}
    for item in surface_channels(format_.modalities):
        if not item.has_content:
            continue
        if (objects := scene.source.capabilities.objects) is not None:
            texts[f"{item.name}.json"] = canonical(item.content_of(objects()))
        elif (mesh := scene.source.mesh) is not None:
            texts[f"{item.name}.json"] = canonical(item.content(mesh(), scene.source.location))
    return texts


def _recorded_imu(plan: Plan, render: Render, sequence: PlannedSequence) -> RecordedImu | None:
    """Return the IMU of a recording, as it was recorded; None where its path is another in this sequence."""
    return None if plan.rig is not None or sequence.skips else render.scene.source.capabilities.imu


def _imu_samples(plan: Plan, sequence: PlannedSequence, paths: SensorPaths, stamps: FrameStamps) -> ImuSamples | None:
    """Return what the rig's IMU measures along a sequence's whole path; None without one.

    It draws by seed and scene alone: settings that follow the same path have the same samples.
    """
    if plan.rig is None or plan.rig.imu is None or paths.robot is None:
        return None
    return measure(paths.robot, plan.rig.imu, stamps.pose.ns[0], (plan.preset.spec.seed, sequence.scene))


def _completed_shares(records: Mapping[int, FrameRecord]) -> dict[int, float]:
    """Return by frame the share of depth that was completed for its colour, of frames of which some was."""
    return {
        frame: record.perturbed[COMPLETED]["share"]
        for frame, record in records.items()
        if COMPLETED in record.perturbed
    }


class Completion:
    """Writes what a dataset has beside its images."""

    def __init__(
        self,
        plan: Plan,
        dataset: Dataset,
        paths_of: Callable[[Render], SensorPaths],
        note: Callable[[str], None],
    ) -> None:
        """Take a dataset that is open. paths_of: returns the sensors' paths in a render. note: tells the user."""
        self._plan = plan
        self._dataset = dataset
        self._paths_of = paths_of
        self._note = note

    def write(self) -> str:
        """Write the text files beside the images, and the manifest; return the manifest's SHA-256."""
        self._dataset.read_on()
        files: dict[str, object] = {}
        counts: dict[str, int] = {}
        pictured: dict[str, list[int]] = {}
        losses: dict[str, RangeLoss] = {}
        completed: dict[str, dict[int, float]] = {}
        format_ = self._plan.format
        one_camera = cameras_agree(self._dataset.identity)
        for render in self._plan.renders:
            exposed = render.scene.source.capabilities.exposures_s is not None
            texts_of: dict[Hashable, dict[str, str]] = {}  # most sequences of a render show the same source frames
            for sequence in render.sequences:
                records = self._finished_frames(render, sequence)
                if not records:
                    continue  # --frames chose none of it
                if motion := motion_of_frames(render, sequence, self._paths_of(render)):
                    records = {frame: record.with_motion(motion[frame]) for frame, record in records.items()}
                coloured = tuple(sequence.source_of("rgb", frame) for frame in records) if exposed else ()
                shown = sequence.source_frames, sequence.skips, tuple(records), coloured
                if shown not in texts_of:
                    texts_of[shown] = self._texts(render, sequence, tuple(records), one_camera=one_camera)
                texts = texts_of[shown]
                files[sequence.folder] = self._dataset.finish_sequence(sequence.folder, texts, records.values())
                counts[sequence.folder] = len(records)
                pictured[sequence.folder] = list(records)
                images = (record.out_of_range for record in records.values())
                if loss := range_loss(images, self._pixels(sequence.scene)):
                    losses[sequence.folder] = loss
                completed.setdefault(sequence.scene, {}).update(_completed_shares(records))
        files |= {} if one_camera else self._texts_beside()
        first = self._plan.renders[0]
        of_setting = format_.setting_texts(first.camera, first.optics) if one_camera else {}
        for setting in {folder.split("/")[0]: None for folder in counts}:
            for name, text in of_setting.items():
                path = f"{setting}/{name}"
                files[path] = self._dataset.write_text(path, text)
        if self._plan.preset.spec.output.overview:
            stamps_of = {scene.name: scene.source.frame_stamps for scene in self._plan.scenes}
            picture = draw_overview(self._dataset.out, format_, pictured, stamps_of)
            files[OVERVIEW] = self._dataset.write_bytes(OVERVIEW, picture)
        digest = self._dataset.write_manifest(manifest(self._plan, self._dataset.identity, files, counts, losses))
        self._note_losses(losses, counts)
        self._note_completed(completed)
        return digest

    def _texts(
        self, render: Render, sequence: PlannedSequence, frames: tuple[int, ...], *, one_camera: bool
    ) -> dict[str, str]:
        """Return the text files of a sequence, by name, but for its frames.jsonl."""
        format_ = self._plan.format
        paths = written_paths(sequence, self._paths_of(render))
        stamps = render.scene.source.frame_stamps
        rig, imu = self._written_rig(render), _imu_samples(self._plan, sequence, paths, stamps)
        if (recorded := _recorded_imu(self._plan, render, sequence)) is not None:
            rig, imu = recorded.rig, recorded.samples
        exposed_s = render.scene.source.capabilities.exposures_s
        if exposed_s is not None:
            exposed_s = exposed_s[[sequence.source_of("rgb", frame) for frame in frames]]
        facts = SequenceFacts(
            *(format_, render.camera, rig, frames, paths, stamps, render.optics, imu), exposures_s=exposed_s
        )
        texts = format_.layout.sequence_texts(facts) | imu_texts(facts) | channel_texts(format_, render.scene)
        return texts if one_camera else texts | format_.setting_texts(render.camera, render.optics)

    def _note_completed(self, shares: dict[str, dict[int, float]]) -> None:
        """Say in a note for each scene how much of the depth that colour depends on was not measured."""
        for scene, by_frame in shares.items():
            if not by_frame:
                continue
            mean, most = sum(by_frame.values()) / len(by_frame), max(by_frame.values())
            text = (
                f"{scene}: {mean:.1%} of the depth that colour depends on is void, not measured (at most {most:.1%} of "
                "a frame): it counts as far as what was measured around it, or as the sky with "
            )
            self._note(Message(text, PresetKey("void", "sky")))

    def _written_rig(self, render: Render) -> Rig | None:
        """Return the rig whose sensors' poses are those of the images: registered depth is where colour is."""
        rig = self._plan.rig
        return replace(rig, depth=None) if rig is not None and render.registers else rig

    def _note_losses(self, losses: dict[str, RangeLoss], counts: dict[str, int]) -> None:
        """Say in a note for each scene how much of its depth is lost, and what keeps it."""
        for scene in self._plan.scenes:
            of_scene = [sequence for sequence in self._plan.sequences if sequence.scene == scene.name]
            lost = {item.setting.name: losses[item.folder] for item in of_scene if item.folder in losses}
            frames = {item.setting.name: counts[item.folder] for item in of_scene if item.folder in losses}
            if lost:
                self._note(Message(f"{scene.name}: ", self._plan.format.depth_range.format_scene_loss(lost, frames)))

    def _texts_beside(self) -> dict[str, object]:
        """Write the intrinsics of the sequences that stay beside the plan's: their settings' files no longer say them.

        Returns the files of these sequences by folder.
        """
        cameras = cameras_of(self._dataset.identity)
        optics = optics_of(self._dataset.identity)
        beyond = {name: stated_optics(self._dataset.out, content) for name, content in optics.items()}
        files: dict[str, object] = {}
        for folder, there in self._dataset.kept.items():
            scene = folder.split("/")[1]
            texts = self._plan.format.setting_texts(cameras[scene], beyond[scene])
            written = {name: self._dataset.write_text(f"{folder}/{name}", text) for name, text in texts.items()}
            files[folder] = there | written
        return files

    def _finished_frames(self, render: Render, sequence: PlannedSequence) -> dict[int, FrameRecord]:
        """Return the complete frames of a sequence, including those of earlier runs, and remove incomplete ones."""
        names = self._dataset.format.names(render.scene.source.frame_stamps)
        records = self._dataset.records(sequence.folder)
        whole = {frame: record for frame, record in records.items() if set(record.files) >= names.of(frame)}
        if lost := [frame for frame in sequence.frames if frame not in whole]:
            raise RuntimeError(f"{sequence.folder}: {len(lost)} frames were not made, {lost[0]} the first")
        self._dataset.drop_frames(sequence.folder, [records[frame] for frame in records.keys() - whole.keys()])
        return whole

    def _pixels(self, scene: str) -> int:
        """Return how many pixels a frame of a scene has."""
        camera = self._plan.depth_cameras[scene]
        return camera.width_px * camera.height_px
