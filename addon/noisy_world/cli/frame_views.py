# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of an opened dataset as people look at them: pictures with words, and a recording of Rerun."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..channels import COLOUR_AND_DEPTH
from ..core.geometry import Intrinsics, invert_pose, pose, rotation_from_quat_wxyz
from ..core.srgb import encoded
from ..core.trajectory import NS_PER_S
from ..dataset.completion import BACKGROUND, INK, LABEL_PX, colour_depth
from ..dataset.loader import Frame, Opened, OpenedSequence, SequenceOfFiles
from ..dataset.sequence import spread
from ..images.pixels import rgb_bytes
from ..layouts.asl import read_samples
from ..layouts.euroc import IMU
from ..layouts.layout import IMU_FILES

if TYPE_CHECKING:
    import rerun
    import rerun.blueprint as layout


CLEAN = "clean"
SAMPLED = 16  # frames whose depths decide the scale of colours; chosen
_FAR_QUANTILE = 0.99  # chosen: a window's far view leaves the room its colours


@dataclass(frozen=True)
class DepthScale:
    """Which depths the colours span, metres."""

    near_m: float
    far_m: float

    @classmethod
    def of(cls, sequence: OpenedSequence, numbers: Sequence[int]) -> "DepthScale":
        """Return that of a few of the frames: from the nearest to what 99 % of the pixels are nearer than."""
        frames = (sequence[number] for number in spread(numbers, SAMPLED))
        seen = [depth_m[depth_m > 0] for depth_m in (frame.depth_m for frame in frames)]
        seen_m = np.concatenate([np.zeros(0, np.float32), *seen])
        if not seen_m.size:
            return cls(0.0, 1.0)
        return cls(float(seen_m.min()), float(np.quantile(seen_m, _FAR_QUANTILE)))


def colour_and_depth_of(opened: Opened) -> tuple[str, ...]:
    """Return which of colour and depth a dataset has; both where it does not say."""
    held = opened.identity.get("output", {}).get("modalities", COLOUR_AND_DEPTH)
    return tuple(name for name in ("rgb", "depth") if name in held)


def shown_colour(frame: Frame) -> NDArray[np.uint8]:
    """Return a frame's colour (H, W, 3), uint8; light of an EXR by sRGB's curve, clipped at 1."""
    rgb = frame.rgb
    return np.asarray(rgb, np.uint8) if rgb.dtype == np.uint8 else rgb_bytes(encoded(np.asarray(rgb, np.float32)))


def panes(frame: Frame, held: Sequence[str], scale: DepthScale) -> list[NDArray[np.uint8]]:
    """Return a frame's colour and depth (H, W, 3), those that there are."""
    shown = [shown_colour(frame)] if "rgb" in held else []
    return shown + ([colour_depth(frame.depth_m, scale.near_m, scale.far_m)] if "depth" in held else [])


def clean_beside(opened: Opened, name: str) -> OpenedSequence | None:
    """Return the clean sequence of the same scene; None where there is none, or it is this one."""
    setting, _, scene = name.partition("/")
    settings: dict[str, Any] = opened.identity.get("settings", {})
    undone = [other for other, what in settings.items() if not what.get("steps")] or [CLEAN]
    found = next((f"{other}/{scene}" for other in undone if f"{other}/{scene}" in opened), None)
    return None if found is None or setting in undone else opened[found]


def source_frame(frame: Frame) -> int:
    """Return the number of the pose on the scene's path that a frame shows: its own without faster motion."""
    return int(frame.done.get("motion", {}).get("source_frame", frame.index))


def planned_pose(frame: Frame) -> NDArray[np.float64]:
    """Return the pose (4, 4) that a frame's camera would have had without deviation: written = planned @ deviation."""
    deviation = frame.done.get("motion", {}).get("deviation")
    if deviation is None:
        return frame.c2w
    turned = rotation_from_quat_wxyz(np.array(deviation["quat_wxyz"], np.float64))
    return frame.c2w @ invert_pose(pose(turned, np.array(deviation["translation_m"], np.float64)))


def words_of(done: Mapping[str, Any]) -> list[str]:
    """Return what was done to a frame, a few words for each thing: `rgb fog severity 3` for instance."""
    words = [
        f"{channel} {step['name']}" + (f" severity {step['severity']:g}" if step.get("severity") is not None else "")
        for channel in ("rgb", "depth")
        for step in done.get(channel, [])
    ]
    motion, pairing = done.get("motion", {}), done.get("pairing", {})
    if "depth_of_frame" in pairing:
        words.append(f"depth of frame {pairing['depth_of_frame']}")
    if "source_frame" in motion:
        words.append(f"source frame {motion['source_frame']}")
    if "deviation" in motion:
        words.append(f"camera {1000 * np.linalg.norm(motion['deviation']['translation_m']):.0f} mm off its path")
    return words


def side_by_side(tiles: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return images (H, W, 3) beside each other, as high as the first one; even sides, as codecs ask for."""
    height = tiles[0].shape[0]
    row = np.concatenate([fitted(tile, height) for tile in tiles], axis=1)
    return np.pad(row, ((0, row.shape[0] % 2), (0, row.shape[1] % 2), (0, 0)), constant_values=BACKGROUND)


def fitted(image: NDArray[np.uint8], height_px: int) -> NDArray[np.uint8]:
    """Return an image (H, W, 3) as high as this."""
    import cv2

    if image.shape[0] == height_px:
        return image
    size = max(1, round(image.shape[1] * height_px / image.shape[0])), height_px
    return np.asarray(cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA), np.uint8)


def lettered(text: str, width_px: int) -> NDArray[np.uint8]:
    """Return a row (LABEL_PX, W, 3) with a text, which is smaller where it would not fit."""
    import cv2

    row = np.full((LABEL_PX, width_px, 3), BACKGROUND, dtype=np.uint8)
    (wide, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    size = 0.5 * min(1.0, (width_px - 8) / max(wide, 1))
    cv2.putText(row, text, (4, 18), cv2.FONT_HERSHEY_SIMPLEX, size, INK, 1, cv2.LINE_AA)
    return row


def stacked(rows: Iterable[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return rows of several widths above each other, from the left."""
    found = list(rows)
    width = max(row.shape[1] for row in found)
    filled = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0)), constant_values=BACKGROUND) for row in found]
    return np.concatenate(filled)


# A sequence as a recording of Rerun: images, paths, the rig, the IMU, and what was done when.
#
# Every scene has a space of its own, SCENE, in which its sequences lie beside each other as SCENE/SETTING, so that
# their paths can be compared. Times are the timeline `time`, seconds since the first frame, and the frames' numbers,
# `frame`.


TRUE_COLOUR, PLANNED_COLOUR = (90, 170, 255), (255, 160, 60)
AXIS_M = 0.1  # the length of a frame's axes; chosen
PLANE_M = 0.3  # how far before the camera its image is drawn; chosen
_SIGNATURES = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}


def root_of(name: str) -> str:
    """Return where a sequence lies in the recording: SCENE/SETTING."""
    setting, _, scene = name.rpartition("/")
    return f"{scene}/{setting or 'sequence'}"


def blueprint(opened: Opened, names: list[str]) -> "layout.Blueprint":
    """Return what the viewer shows: a tab for each sequence, with its scene, its images, its IMU and its words."""
    import rerun.blueprint as layout

    held = colour_and_depth_of(opened)
    tabs = []
    for name in names:
        root, scene = root_of(name), root_of(name).split("/")[0]
        images = [layout.Spatial2DView(origin=f"{root}/camera/{part}", name=part) for part in held]
        plots = [layout.TimeSeriesView(origin=f"{root}/imu/{part}", name=part) for part in ("gyro", "accel")]
        plots = plots if imu_text(opened, name) is not None else []
        words = [
            layout.TimeSeriesView(origin=f"{root}/severity", name="severities"),
            layout.TextLogView(origin=f"{root}/done", name="what was done"),
        ]
        beside = layout.Vertical(*images, *plots, *words)
        tabs.append(layout.Horizontal(layout.Spatial3DView(origin=scene, name=scene), beside, name=name))
    return layout.Blueprint(layout.Tabs(*tabs), collapse_panels=True)


def imu_text(opened: Opened, name: str) -> tuple[str, str] | None:
    """Return the text of an IMU's samples and its file's name; None where a sequence has none."""
    for file in (f"{IMU}/data.csv", IMU_FILES[0]):
        data = opened[name].text(file)
        if data is not None:
            return data.decode(), file
    return None


@dataclass(frozen=True, eq=False)
class Recorder:
    """Sends a sequence to a recording."""

    stream: "rerun.RecordingStream"
    opened: Opened
    name: str

    @property
    def root(self) -> str:
        """Where it lies in the recording."""
        return root_of(self.name)

    @cached_property
    def _first_s(self) -> float:
        sequence = self.opened[self.name]
        return sequence[sequence.frames[0]].stamp_s

    def record(self, numbers: list[int], every: int) -> list[str]:
        """Send frames, images of every n-th one alone; return what is not there, in sentences."""
        import rerun

        self._log(self.root.split("/")[0], rerun.ViewCoordinates.RIGHT_HAND_Z_UP)
        for number in numbers:
            self._frame(self.opened[self.name][number], images=(number - numbers[0]) % every == 0)
        self._paths(numbers)
        self._rig()
        return [*self._imu(), *self._lens()]

    # --- what does not change ---

    def _log(self, path: str, *parts: Any) -> None:
        for part in parts:
            self.stream.log(path, part, static=True)

    def _paths(self, numbers: list[int]) -> None:
        """The written path of the colour camera, and the planned one where motion deviates from it."""
        frames = [self.opened[self.name][number] for number in numbers]
        true = np.array([frame.c2w for frame in frames])
        planned = np.array([planned_pose(frame) for frame in frames])
        self._path("path", true, TRUE_COLOUR)
        if not np.array_equal(true, planned):
            self._path("path_planned", planned, PLANNED_COLOUR)

    def _path(self, part: str, c2w: NDArray[np.float64], colour: tuple[int, int, int]) -> None:
        import rerun

        known = c2w[np.isfinite(c2w).all(axis=(1, 2)), :3, 3]
        strip = rerun.LineStrips3D([known], colors=[colour], radii=rerun.Radius.ui_points(1.5), labels=[part])
        self._log(f"{self.root}/{part}", strip)

    def _rig(self) -> None:
        """The sensors' frames, in that of the colour camera."""
        import rerun

        for part, rgb_from_sensor in self._sensors().items():
            axes = rerun.TransformAxes3D(AXIS_M)
            self._log(f"{self.root}/camera/{part}", _transform(rgb_from_sensor), axes)
        for part, camera in self._cameras.items():
            pinhole = rerun.Pinhole(
                image_from_camera=[[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]],
                width=camera.width_px,
                height=camera.height_px,
                camera_xyz=rerun.ViewCoordinates.RDF,
                image_plane_distance=PLANE_M,
            )
            self._log(f"{self.root}/camera/{part}", pinhole)

    def _sensors(self) -> dict[str, NDArray[np.float64]]:
        """Return the pose (4, 4) of each frame of the rig in the colour camera's."""
        rig = self.opened.identity.get("rig")
        if rig is None:
            return {"depth": self._depth_pose}
        rgb_from_robot = invert_pose(np.array(rig["rgb"], np.float64))
        found = {"depth": self._depth_pose, "robot": rgb_from_robot}
        if rig.get("imu") is not None:
            found["imu"] = rgb_from_robot @ np.array(rig["imu"]["robot_from_sensor"], np.float64)
        return found

    @cached_property
    def _depth_pose(self) -> NDArray[np.float64]:
        """(4, 4): the depth camera in the colour camera's frame."""
        rig, sequence = self.opened.identity.get("rig"), self.opened[self.name]
        if rig is not None and rig.get("depth") is not None:
            return invert_pose(np.array(rig["rgb"], np.float64)) @ np.array(rig["depth"], np.float64)
        if isinstance(sequence, SequenceOfFiles) and sequence.stored.optics.depth is not None:
            return sequence.stored.optics.depth.matrix
        return np.eye(4)

    @cached_property
    def _cameras(self) -> dict[str, Intrinsics]:
        """The intrinsics of colour and depth, where a file says them."""
        sequence = self.opened[self.name]
        if sequence.camera is None:
            return {}
        own = sequence.stored.optics.depth if isinstance(sequence, SequenceOfFiles) else None
        known = {"rgb": sequence.camera, "depth": sequence.camera if own is None else own.intrinsics}
        return {part: known[part] for part in colour_and_depth_of(self.opened)}

    def _lens(self) -> Iterator[str]:
        if self.opened[self.name].distortion is not None:
            yield "its lens distorts, and Rerun draws its rays as a pinhole's"

    # --- what changes ---

    def _at(self, number: int, stamp_s: float) -> None:
        self.stream.set_time("frame", sequence=number)
        self.stream.set_time("time", duration=stamp_s - self._first_s)

    def _frame(self, frame: Frame, *, images: bool) -> None:
        """Send a frame: where the camera is, what it saw, and what was done."""
        import rerun

        self._at(frame.index, frame.stamp_s)
        if np.isfinite(frame.c2w).all():
            self.stream.log(f"{self.root}/camera", _transform(frame.c2w))
        held = colour_and_depth_of(self.opened) if images else ()
        if "rgb" in held:
            self.stream.log(f"{self.root}/camera/rgb", _colour(frame))
        if "depth" in held:
            self._at(frame.index, frame.depth_stamp_s)
            self.stream.log(f"{self.root}/camera/depth", _depth(frame))
            self._at(frame.index, frame.stamp_s)
        if words := words_of(frame.done):
            self.stream.log(f"{self.root}/done", rerun.TextLog("; ".join(words)))
        for steps in (frame.done.get(channel, []) for channel in ("rgb", "depth")):
            for step in steps:
                if step.get("severity") is not None:
                    self.stream.log(f"{self.root}/severity/{step['name']}", rerun.Scalars(step["severity"]))

    def _imu(self) -> Iterator[str]:
        """Send the samples, at the stamps of the IMU's own clock."""
        import rerun

        found = imu_text(self.opened, self.name)
        if found is None:
            if (self.opened.identity.get("rig") or {}).get("imu") is not None:
                yield "the samples of its IMU are no part of a recipe"
            return
        stamps_ns, values = read_samples(*found)
        times = rerun.TimeColumn("time", duration=stamps_ns / NS_PER_S - self._first_s)
        for part, columns in (("gyro", values[:, :3]), ("accel", values[:, 3:])):
            unit = "rad/s" if part == "gyro" else "m/s^2"
            for axis, column in zip("xyz", columns.T, strict=True):
                path = f"{self.root}/imu/{part}/{axis}"
                self._log(path, rerun.SeriesLines(names=[f"{axis} [{unit}]"]))
                self.stream.send_columns(path, indexes=[times], columns=rerun.Scalars.columns(scalars=column))


def _transform(matrix: NDArray[np.float64]) -> "rerun.Transform3D":
    import rerun

    return rerun.Transform3D(translation=matrix[:3, 3], mat3x3=matrix[:3, :3])


def _colour(frame: Frame) -> "rerun.EncodedImage | rerun.Image":
    """Return the colour image: the file itself where it is a PNG or a JPEG."""
    import rerun

    data = frame.rgb_bytes()
    kind = next((kind for signature, kind in _SIGNATURES.items() if data.startswith(signature)), None)
    return rerun.Image(shown_colour(frame)) if kind is None else rerun.EncodedImage(contents=data, media_type=kind)


def _depth(frame: Frame) -> "rerun.EncodedDepthImage | rerun.DepthImage":
    """Return the depth image in metres: the file itself, with its steps per metre, where it is a PNG."""
    import cv2
    import rerun

    data, depth_m = frame.depth_bytes(), frame.depth_m
    steps = None
    if data.startswith(b"\x89PNG"):
        steps = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if steps is None or steps.shape != depth_m.shape or not depth_m.any() or (steps[depth_m == 0] > 0).any():
        return rerun.DepthImage(depth_m, meter=1.0)
    place = np.unravel_index(int(np.argmax(depth_m)), depth_m.shape)
    return rerun.EncodedDepthImage(data, media_type="image/png", meter=round(float(steps[place] / depth_m[place]), 3))
