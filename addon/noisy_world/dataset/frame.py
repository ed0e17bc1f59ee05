# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame of a sequence: what it shows, what is done to it, what is recorded of it, and its images.

All who ask for these ask it: what writes a dataset and what takes it up again, recipes, the library, the panel.
"""

from collections.abc import Callable, Collection, Hashable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS, in_order
from ..core.camera_motion import CameraMotion
from ..core.errors import InputError
from ..core.file_access import read_bytes
from ..core.frame_request import SensorPaths
from ..core.frame_table import COMPLETED
from ..core.geometry import quat_wxyz_from_rotation
from ..layouts import Modality, OutputFormat
from ..perturbations.execution import ColourWork, DepthWork, Notes, chosen_poses, drawn_motion
from ..perturbations.kinds import FrameContext
from .plan import Render
from .sequence import PlannedSequence, ShownSources, array_of

if TYPE_CHECKING:
    from .clean_frame import Camera, CleanFrame, CleanPair


@dataclass(frozen=True)
class CleanFrames:
    """What frames of a sequence are made from: the clean frames of a render, and the cameras that took them.

    colour, depth: the cameras of both images. frame: returns a source frame by its number. pair: returns what leads
    from one to another. composited: returns a frame's colour as Blender's compositor has perturbed it, None where that
    is the clean one. Each is None where nothing asks for it.
    """

    colour: "Camera"
    depth: "Camera | None" = None
    frame: "Callable[[int], CleanFrame] | None" = None
    pair: "Callable[[ShownSources], CleanPair] | None" = None
    composited: "Callable[[Frame], NDArray[Any] | None] | None" = None

    def of_one(self, clean: "CleanFrame") -> "CleanFrames":
        """Return the one clean frame of these that is at hand."""
        return replace(self, frame=lambda _source: clean)


class Frame:
    """A frame of a sequence, each of its images made when it is first needed.

    Without clean frames it tells what follows from the plan alone: its sources, its steps and their part of the record.
    """

    def __init__(self, sequence: PlannedSequence, index: int, clean: CleanFrames | None = None) -> None:
        """Look up what it shows. index: its number in the sequence. Raises ValueError if it is left out."""
        self.sequence = sequence
        self.index = index
        self.shown = sequence.shown(index)
        self._from = clean
        self._changed: dict[str, NDArray[Any] | None] = {}  # by the steps that a channel has

    # --- what is done to it ---

    @cached_property
    def colour(self) -> ColourWork:
        """What is done to its colour. Before other threads ask: where earlier frames are looked at, they are read."""
        camera = None if self._from is None else self._from.colour
        return ColourWork.of(self.sequence.setting.rgb, self._context(self.index, camera, self.shown.rgb_source))

    @cached_property
    def depth(self) -> DepthWork:
        """What is done to its depth, which draws by the streams of the frame that the depth belongs to."""
        camera = None if self._from is None else self._from.depth
        context = self._context(self.shown.depth_frame, camera, self.shown.depth_source)
        return DepthWork.of(self.sequence.setting.depth, context)

    def _context(self, index: int, camera: "Camera | None", source: int) -> FrameContext:
        """Return what steps are given. index: by which they draw. source: the clean frame that they act on."""
        sequence, setting = self.sequence, self.sequence.setting
        if self._from is None or camera is None:
            return FrameContext(index, sequence.identifiers, shutter=setting.shutter)
        earlier, earlier_key = None, None
        if setting.looks_back:
            known = camera.earlier
            earlier, earlier_key = (self._alone, None) if known is None else known.before(sequence, index)
        return FrameContext(
            index=index,
            identifiers=sequence.identifiers,
            stamp_s=float(camera.stamps_s[index]),
            intrinsics=camera.intrinsics,
            motion=self.motion if camera is self._from.colour else None,
            read_rgb=(lambda: self._clean(source).read_rgb()) if setting.needs_rgb else None,
            read_depth_m=(lambda: self._clean(source).read_seen_depth_m()) if setting.needs_depth else None,
            read_earlier=earlier,
            earlier_key=earlier_key,
            shutter=setting.shutter,
        )

    @cached_property
    def motion(self) -> CameraMotion | None:
        """How the colour camera moves, where a step asks for it and its path is known."""
        if self._from is None or not self.sequence.setting.uses_motion:
            return None
        return self._from.colour.motion(self.sequence, self.index)

    def steps(self, channel: Modality) -> Notes:
        """Return what is done to the image of a channel: each step with its stream, severity and parameters."""
        match CHANNELS[channel].steps:
            case "rgb" if self.sequence.setting.composited:
                from ..nodes.chain import group_note  # only Blender's compositor has groups

                return [group_note(*drawn) for drawn in self.colour.drawn]
            case "rgb":
                return self.colour.notes
            case "depth":
                return self.depth.notes
            case None:
                return []

    def sources(self, channel: Modality) -> ShownSources:
        """Return the source frames that the image of a channel is made of."""
        return self.sequence.shows(channel, self.index)

    def key(self, channel: Modality) -> Hashable:
        """Return what makes equal images of a channel, whatever the sequence: the clean image, and what is done to it.

        Node groups that serve more than by default give other images, too.
        """
        done: Hashable = None
        if self.sequence.setting.on(channel):
            match CHANNELS[channel].steps:
                case "rgb" if self.sequence.setting.composited:
                    from ..nodes.chain import capacity_of  # likewise

                    capacities = tuple(tuple(capacity_of(step).items()) for step, _, _ in self.colour.active)
                    done = "compositor", self.colour.key, capacities
                case "rgb":
                    done = "reference", self.colour.key
                case _:
                    done = self.depth.key
        return channel, self.sources(channel), done

    # --- its record ---

    def record(self, channels: Collection[Modality], written: Collection[Modality]) -> dict[str, Any]:
        """Return what is done to images of some channels, as frames.jsonl has it, but for motion.

        written: all channels that the dataset has. Without clean frames it is what the plan tells: no exposure, and
        nothing that automatics decide or that is found in a frame's depth.
        """
        found: dict[str, Any] = {}
        for channel in map(CHANNELS.__getitem__, in_order(channels)):
            if channel.steps is not None and self.sequence.setting.on(channel.name):
                found[channel.steps] = self.steps(channel.name)
                if channel.steps == "rgb" and self._from is not None:
                    found |= self._found_in_colour()
            if channel.paired and self.sequence.paired:
                found["pairing"] = {"depth_of_frame": self.shown.depth_frame}
            if self._from is None or channel.pairs or (channel.paired and "rgb" in written):
                continue  # with colour, the exposure is colour's: depth may be another frame's
            if exposure := self._clean_of(channel.name).exposure:
                found["exposure"] = exposure
        return found

    def _found_in_colour(self) -> dict[str, Any]:
        """Return what automatics decided, and what of the depth that was looked at had not been measured."""
        found = {"camera": dict(self.colour.decided), COMPLETED: self._clean_of("rgb").completed(self.colour)}
        return {name: values for name, values in found.items() if values}

    # --- its images ---

    def _clean(self, source: int) -> "CleanFrame":
        assert self._from is not None, "it has clean frames"
        assert self._from.frame is not None, "it has clean frames"
        return self._from.frame(source)

    def _clean_of(self, channel: Modality) -> "CleanFrame":
        return self._clean(self.shown.depth_source if CHANNELS[channel].paired else self.shown.rgb_source)

    def _alone(self, span_s: float) -> Any:
        """Return what was before it if it had been shown for long."""
        return self._clean(self.shown.rgb_source).alone(span_s)

    def changed(self, channel: Modality) -> NDArray[Any] | None:
        """Return the image of a channel after its steps: colour rounded, or light, or depth; None for the clean one."""
        kind = CHANNELS[channel].steps
        if kind is None or not self.sequence.setting.on(channel):
            return None
        if kind not in self._changed:
            self._changed[kind] = self._made(kind)
        return self._changed[kind]

    def _made(self, kind: str) -> NDArray[Any] | None:
        if kind == "depth":
            return self._clean_of("depth").perturbed_depth(self.depth)
        if self.sequence.setting.composited:
            assert self._from is not None, "it has clean frames"
            assert self._from.composited is not None, "the compositor has been asked"
            return self._from.composited(self)
        return self._clean_of("rgb").perturbed_rgb(self.colour)

    def pixels(self, channel: Modality) -> NDArray[Any]:
        """Return the image of a channel before it is encoded: colour (H, W, 3), depth (H, W) in metres, 0 = void."""
        pixels = self.changed(channel)
        if pixels is not None:
            return pixels
        if CHANNELS[channel].pairs:
            assert self._from is not None, "it has clean frames"
            assert self._from.pair is not None, "what perturbs images has no such channels"
            return self._from.pair(self.sources(channel)).image(channel)
        return self._clean_of(channel).image(channel)

    @property
    def rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3), RGB, before it is encoded."""
        pixels = self.changed("rgb")
        return self._clean_of("rgb").byte_rgb if pixels is None else pixels

    @property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void, before it is rounded to steps."""
        return self.pixels("depth")

    def stored_rgb(self, written: OutputFormat) -> NDArray[np.uint8] | NDArray[np.float32]:
        """Return colour (H, W, 3), RGB, as a dataset's image holds it if nothing is lost in encoding."""
        pixels = self.changed("rgb")
        return written.stored_rgb(self._clean_of("rgb").rgb if pixels is None else pixels)

    def rgb_to_decode(self, written: OutputFormat) -> bytes:
        """Return bytes that decode to the pixels of colour's file, and take less time where these are noisy."""
        pixels = self.changed("rgb")
        return self.bytes("rgb", written) if pixels is None else written.encode_rgb(pixels, fit_tables=False)

    def bytes(self, channel: Modality, written: OutputFormat) -> bytes:
        """Return the image of a channel as a dataset's file holds it."""
        kind, pixels = CHANNELS[channel], self.changed(channel)
        if pixels is not None:
            return kind.encode(pixels, written)
        if kind.pairs:
            return kind.encode_clean(self.pixels(channel), written)
        whole = self._clean_of(channel).file_as(channel, written)
        return kind.encode_clean(self.pixels(channel), written) if whole is None else _content(whole.path)


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error


# The record of motion in frames.jsonl: which pose of the planned path a frame shows, and its deviation.


Float64: TypeAlias = NDArray[np.float64]


def motion_of_frames(render: Render, sequence: PlannedSequence, paths: SensorPaths) -> list[dict[str, Any]]:
    """Return for each frame of a sequence what motion did to it; [] where it did nothing.

    paths: the render's. source_frame: the number of the pose on the scene's path, where frames show others than their
    own. deviation: of the colour camera from the planned path: the planned pose, times this pose, is the true one;
    translation_m in the planned camera's axes, quat_wxyz. drawn: what the perturbations drew, by their names.
    """
    rows = array_of(sequence.source_frames)  # of the render's path
    count = render.scene.frame_count
    chosen = chosen_poses(render.moving, count, render.identifiers)
    planned = rows if chosen is None else chosen[rows]
    found: list[dict[str, Any]] = [{} for _ in rows]
    if not np.array_equal(planned, np.arange(len(planned))):
        for frame, pose in zip(found, planned.tolist(), strict=True):
            frame["source_frame"] = pose
    if paths.nominal is not None:
        nominal, true = paths.nominal.c2w[rows], paths.rgb.c2w[rows]
        to_camera = nominal[:, :3, :3].swapaxes(1, 2)
        # The difference first: far from the origin, little of it would be left of the product of poses.
        moved_m = _product(to_camera, true[:, :3, 3:] - nominal[:, :3, 3:])[..., 0] + 0.0
        quats_wxyz = quat_wxyz_from_rotation(_product(to_camera, true[:, :3, :3])) + 0.0
        for frame, translation_m, quat_wxyz in zip(found, moved_m.tolist(), quats_wxyz.tolist(), strict=True):
            frame["deviation"] = {"translation_m": translation_m, "quat_wxyz": quat_wxyz}
    for name, made in drawn_motion(render.moving, count, render.identifiers).items():
        for frame, row in zip(found, rows, strict=True):
            frame.setdefault("drawn", {})[name] = {key: (values[row] + 0.0).tolist() for key, values in made.items()}
    return found if any(found) else []


def _product(left: Float64, right: Float64) -> Float64:
    """(N, 3, 3), (N, 3, K) -> (N, 3, K): their product, added up in one order, so the same everywhere."""
    return sum((left[:, :, k, None] * right[:, k, None, :] for k in (1, 2)), left[:, :, 0, None] * right[:, 0, None, :])
