# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame is one value: its source frames, its steps, its key, its record and its images.

All who ask for these ask it: what writes a dataset and what takes it up again, recipes, the library, the panel.
"""

import contextlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS
from ..channels.channel import PairChannel, View
from ..core.camera_motion import CameraMotion, motion_between
from ..core.errors import InputError
from ..core.file_access import read_bytes
from ..core.frame_request import SensorPaths
from ..core.frame_table import COMPLETED
from ..core.geometry import Intrinsics, quat_wxyz_from_rotation
from ..core.machine import DECODING, StageTimer, keep_freed_memory
from ..core.trajectory import Trajectory
from ..images.image_files import WholeFile
from ..images.measured_depth import Registration, completed_m
from ..images.pixels import as_bytes, as_float, rgb_bytes
from ..layouts import Modality, OutputFormat
from ..perturbations.execution import (
    ColourWork,
    DepthWork,
    Notes,
    acts_on_light,
    after_light,
    chosen_poses,
    drawn_motion,
    on_light,
)
from ..perturbations.kinds import MID_GREY, ColourPerturbation, EarlierFrame, FrameContext, ReadEarlier, earlier_than
from ..perturbations.steps import Step
from ..render.source import Motion, OpenSource, SceneLight, SourceFrame, light_seen
from ..render.source import motion_between as motion_of_points
from .sequence import PlannedSequence, ShownSources, array_of

if TYPE_CHECKING:
    from ..nodes.compositor import Compositor
    from .plan import Render


SKY_BEHIND_GLASS_M = 500.0  # as far away as haze, rain and snow take the sky to be
KEPT = 4096  # small images: 36 MiB at most, more than any frame of 60 Hz looks back; chosen
OUTDOORS = 0.02  # share of open sky from which on that holds; less counts in part, so that nothing jumps; chosen


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
    composited: "Callable[[PlannedFrame], NDArray[Any] | None] | None" = None

    def of_one(self, clean: "CleanFrame") -> "CleanFrames":
        """Return the one clean frame of these that is at hand."""
        return replace(self, frame=lambda _source: clean)


class PlannedFrame:
    """A frame of a sequence, each of its images made when it is first needed.

    Without clean frames it tells what follows from the plan alone: its sources, its steps and their part of the record.
    """

    def __init__(self, sequence: PlannedSequence, index: int, clean: CleanFrames | None = None) -> None:
        """Look up what it shows. index: its number in the sequence. Raises ValueError if it is left out."""
        self.sequence = sequence
        self.index = index
        self.shown = sequence.shown(index)
        self._from = clean
        self._clean_frames: dict[int, CleanFrame] = {}  # by the source frame: colour's, and depth's
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

    def key(self, channel: Modality) -> tuple[Modality, ShownSources, Hashable]:
        """Return what makes equal images of a channel, whatever the sequence: the clean image, and what is done to it.

        Node groups that serve more than by default give other images, too.
        """
        done: Hashable = None
        match CHANNELS[channel].steps:
            case "rgb" if self.colour.active and self.sequence.setting.composited:
                from ..nodes.chain import capacity_of

                capacities = tuple(tuple(capacity_of(step).items()) for step, _, _ in self.colour.active)
                done = "compositor", self.colour.key, capacities
            case "rgb" if self.colour.active:
                done = "reference", self.colour.key
            case "depth" if self.depth.active:
                done = self.depth.key
            case _:
                pass
        return channel, self.sources(channel), done

    # --- its record ---

    def record(self, channels: Collection[Modality], written: Collection[Modality]) -> dict[str, Any]:
        """Return what is done to images of some channels, given in their order, as frames.jsonl has it but for motion.

        written: all channels that the dataset has. Without clean frames it is what the plan tells: no exposure, and
        nothing that automatics decide or that is found in a frame's depth.
        """
        found: dict[str, Any] = {}
        for channel in map(CHANNELS.__getitem__, channels):
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
        if source not in self._clean_frames:
            assert self._from is not None, "it has clean frames"
            assert self._from.frame is not None, "it has clean frames"
            self._clean_frames[source] = self._from.frame(source)
        return self._clean_frames[source]

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

    def taken(self, channel: Modality) -> NDArray[Any] | None:
        """Return what `changed` does, and keep it no longer: a clean frame is written in many settings, one by one."""
        changed = self.changed(channel)
        if (kind := CHANNELS[channel].steps) is not None:
            self._changed.pop(kind, None)
        return changed

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


class CleanFrame:
    """The images of a source frame, each read when it is first needed."""

    def __init__(
        self,
        source: int,
        image: SourceFrame,
        between: Registration | None = None,
        timer: StageTimer | None = None,
        *,
        of_light: bool = False,
        registers: bool = False,
        unmeasured_m: Callable[[int], float] | None = None,
    ) -> None:
        """Hold a frame. source: its number on the path. between: colour and depth, where these have two cameras.
        registers: whether depth is laid into colour's pixels once it is measured.

        timer: hears how long images take that are read from files; None where they are not. of_light: what is stored
        of its colour is light, before the view transform. unmeasured_m: as a source's capabilities say it.
        """
        self.source = source
        self.shown: ShownSources = (source, None)
        self._image = image
        self._between = between
        self._timer = timer
        self._of_light = of_light
        self._registers = registers and between is not None
        self._unmeasured_m = unmeasured_m
        self._of_lights: dict[Hashable, NDArray[Any] | None] = {}  # what steps make of a lit frame, by their key

    @property
    def exposure(self) -> list[Mapping[str, Any]]:
        """What the exposure of the frame did, for its record; empty without one."""
        return list(self._image.exposure)

    @cached_property
    def rgb(self) -> NDArray[np.float32] | NDArray[np.uint8]:
        """Colour (H, W, 3), float32 in [0, 1] or uint8."""
        with self._decoding():
            rgb = self._image.rgb
        assert rgb is not None, "colour was not asked for"
        return rgb

    @cached_property
    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void, in the pixels in which it is written."""
        return self._depth_in_colour_m if self._registers else self.measured_depth_m

    @cached_property
    def measured_depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres, 0 = void, as its own camera sees it."""
        with self._decoding():
            depth_m = self._image.depth_m
        assert depth_m is not None, "depth was not asked for"
        return depth_m

    def image(self, modality: Modality) -> NDArray[Any]:
        """Return the image of a channel; colour and depth are kept once they are read."""
        match modality:
            case "rgb" if self._of_light:
                assert self.light is not None, "its source is lit"
                return self.light.rgb
            case "rgb":
                return self.rgb
            case "depth":
                return self.depth_m
            case _:
                found = self._image.image(modality)
                assert found is not None, f"{modality} was not asked for"
                return found

    def _decoding(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext() if self._timer is None else self._timer.on(DECODING)

    def float_rgb(self) -> NDArray[np.float32]:
        """Return colour (H, W, 3) as float32 in [0, 1]."""
        return as_float(self.rgb)

    @cached_property
    def byte_rgb(self) -> NDArray[np.uint8]:
        """Colour (H, W, 3) as uint8, rounded if it is float."""
        return as_bytes(self.rgb)

    @cached_property
    def light_seen(self) -> NDArray[np.float32]:
        """What a meter sees of it, as `small_light`."""
        return light_seen(self._image)

    def alone(self, _span_s: float) -> tuple[EarlierFrame, ...]:
        """Return what was before it if it had been shown for long."""
        return (EarlierFrame(0.0, self.light_seen),)

    @property
    def light(self) -> SceneLight | None:
        """Colour before the view transform, of a lit frame."""
        return self._image.light

    def perturbed_rgb(self, work: ColourWork) -> NDArray[Any] | None:
        """Return colour (H, W, 3) uint8, or light float32, after steps of colour; None where they are the identity.

        Where a step acts on a lit frame's light, it has to be called in the main thread, before the next frame is made.
        """
        if self.light is None:
            return work.on(self.byte_rgb if work.takes_bytes else self.rgb)
        if work.key not in self._of_lights:
            self._of_lights[work.key] = self._perturbed_light(work, self.light)
        return self._of_lights[work.key]

    def _perturbed_light(self, work: ColourWork, light: SceneLight) -> NDArray[Any] | None:
        if self._of_light:
            return on_light(work, light.rgb, light.mirrored) if work.active else None
        if acts_on_light(work):
            return after_light(work, light.show(on_light(work, light.rgb, light.mirrored)))
        return work.on(self.byte_rgb if work.takes_bytes else self.rgb)

    def perturbed_depth(self, work: DepthWork) -> NDArray[np.float32] | None:
        """Return depth (H, W) after steps of depth; None where they are the identity.

        What a rig's sensor measures is registered after it, and before the setting's own steps.
        """
        between = self._between
        if not self._registers or between is None:
            return work.on(self.depth_m)
        sensing, others = work.parted(between.depth.intrinsics, self.read_measured_rgb)
        measured_m = sensing.on(self.measured_depth_m)
        seen_m = self.depth_m if measured_m is None else between.depth_in_colour(measured_m)
        made_m = others.on(seen_m)
        return made_m if made_m is not None or measured_m is None else seen_m

    @cached_property
    def _depth_in_colour_m(self) -> NDArray[np.float32]:
        measured_m = self.measured_depth_m
        return measured_m if self._between is None else self._between.depth_in_colour(measured_m)

    def read_depth_m(self) -> NDArray[np.float32]:
        """Return the depth as the colour camera sees it; a function that contexts can hand on."""
        return self._depth_in_colour_m

    @cached_property
    def _completed_depth_m(self) -> NDArray[np.float32]:
        """Planar depth (H, W) in metres as the colour camera sees it, 0 = sky: what was not measured is completed."""
        depth_m = self._depth_in_colour_m
        if self._unmeasured_m is None:
            return depth_m
        if depth_m.any():
            return completed_m(depth_m)
        return np.full_like(depth_m, self._unmeasured_m(self.source))

    def completed(self, work: ColourWork) -> dict[str, float]:
        """Return what of the depth that steps of colour look at was not measured, for the frame's record.

        share: of the pixels. depth_m: how far all of them count, where none was measured. Empty where there is none.
        """
        if self._unmeasured_m is None or not work.needs_depth:
            return {}
        measured = int(np.count_nonzero(self._depth_in_colour_m)) / self._depth_in_colour_m.size
        if measured == 1:
            return {}
        found = {"share": round(1 - measured, 6)}
        return found if measured else found | {"depth_m": round(float(self._completed_depth_m[0, 0]), 6)}

    def read_seen_depth_m(self) -> NDArray[np.float32]:
        """Return the depth of what colour shows, through panes of glass, for what acts on colour; as `read_depth_m`.

        Of a lit frame, sky behind a pane is a surface: the sky that a window shows does not light the room's air. It is
        far away beside open sky, so that a pane punches no hole into weather, and at the pane in a room without any.
        """
        behind_m = self._image.behind_glass_m
        if behind_m is None or self.light is None:
            return self._completed_depth_m if behind_m is None else behind_m
        pane_m = self.read_depth_m()
        outdoors = min(float((pane_m == 0).mean()) / OUTDOORS, 1.0)
        sky_m = pane_m ** np.float32(1 - outdoors) * np.float32(SKY_BEHIND_GLASS_M**outdoors)
        return np.where((pane_m > 0) & ~(behind_m > 0), sky_m, behind_m)

    def read_rgb(self) -> NDArray[np.float32]:
        """Return colour (H, W, 3), float32 in [0, 1], in depth's pixels as these are written, for contexts likewise."""
        return self.float_rgb() if self._registers else self.read_measured_rgb()

    def read_measured_rgb(self) -> NDArray[np.float32]:
        """Return colour (H, W, 3), float32 in [0, 1], as the depth camera sees it, for contexts likewise."""
        rgb = self.float_rgb()
        return rgb if self._between is None else self._between.colour_in_depth(rgb, self.measured_depth_m)

    def file_as(self, modality: Modality, format_: OutputFormat) -> WholeFile | None:
        """Return an existing file that holds an image exactly as a dataset would write it, or None."""
        return self._image.file_as(modality, format_)


def clean_frames_of(
    render: "Render", timer: StageTimer | None = None, *, of_light: bool = False
) -> Callable[[int, SourceFrame], CleanFrame]:
    """Return what makes clean frames of what the source of a render gives, and their numbers.

    timer, of_light: as `CleanFrame` takes them.
    """
    unmeasured_m = render.scene.source.capabilities.unmeasured_m
    own = {"timer": timer, "of_light": of_light, "registers": render.registers, "unmeasured_m": unmeasured_m}
    return partial(CleanFrame, between=render.registration, **own)


class EarlierFrames:
    """What the frames of one render's sequences have before them.

    stamps_s: (N,) of the sequence's frames. read: returns what a meter sees of a source frame that is not kept.
    """

    def __init__(self, stamps_s: NDArray[np.float64], read: Callable[[int], NDArray[np.float32]]) -> None:
        self._stamps_s = stamps_s
        self._read = read
        self._kept: OrderedDict[int, EarlierFrame] = OrderedDict()
        self._lock = threading.Lock()

    def before(self, sequence: PlannedSequence, frame: int) -> tuple[ReadEarlier, Hashable]:
        """Return what reads the frames before one of a sequence, and what is equal where these are.

        They are looked up at once, so that later it may be called in any thread.
        """
        numbers = earlier_than(self._stamps_s, frame, sequence.setting.looks_back_s)
        sources = tuple(int(sequence.source_frames[number]) for number in numbers)
        stamps_s = self._stamps_s
        seen = tuple(
            replace(self._frame(source), stamp_s=float(stamps_s[number]))
            for number, source in zip(numbers, sources, strict=True)
        )

        def read(span_s: float) -> tuple[EarlierFrame, ...]:
            return seen[-len(earlier_than(stamps_s, frame, span_s)) :]

        return read, (frame, sources)

    def prepare(self, sequence: PlannedSequence, frame: int) -> None:
        """Read what is before a frame of a sequence and is not kept, but for what the frame itself shows."""
        own = sequence.source_frames[frame]
        for number in earlier_than(self._stamps_s, frame, sequence.setting.looks_back_s):
            if (source := int(sequence.source_frames[number])) != own:
                self._frame(source)

    def keep(self, source: int, light: NDArray[np.float32]) -> None:
        """Keep what a meter sees of a source frame."""
        with self._lock:
            self._kept[source] = EarlierFrame(0.0, light)
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)

    def _frame(self, source: int) -> EarlierFrame:
        if (frame := self._kept.get(source)) is None:
            light = self._read(source)
            self.keep(source, light)
            frame = self._kept.get(source) or EarlierFrame(0.0, light)
        return frame


class GreyFrames(EarlierFrames):
    """What frames have before them where none are known, as in a live preview: mid-grey."""

    def __init__(self) -> None:
        super().__init__(np.zeros(0), lambda _source: MID_GREY.light)

    def before(self, sequence: PlannedSequence, frame: int) -> tuple[ReadEarlier, Hashable]:
        """Return what reads a mid-grey frame."""
        del sequence, frame
        return lambda _span_s: (MID_GREY,), None


@dataclass(frozen=True)
class CleanPair:
    """A source frame and the next one that a sequence shows, with what the colour camera sees at both.

    here, there: None where nothing comes after.
    """

    shown: ShownSources
    camera: Intrinsics
    here: View | None = None
    there: View | None = None

    def image(self, modality: Modality) -> NDArray[Any]:
        """Return the image of a channel that leads on."""
        channel = CHANNELS[modality]
        assert isinstance(channel, PairChannel)
        if self.here is None or self.there is None:
            return channel.of_last(self.camera)
        return channel.of_views(self.here, self.there)

    def file_as(self, modality: Modality, written: OutputFormat) -> None:
        """Return None: no recording has such files."""


@dataclass(frozen=True)
class Camera:
    """What is known about the camera beside its images.

    intrinsics: None where unknown. stamps_s: (N,) time stamps of the images of the path's frames, colour or depth,
    seconds; frame i of a sequence has the i-th. path: of the camera, a pose for each source frame; None where unknown.
    earlier: what sequences showed before a frame; None where no step of colour asks, or where a frame is
    shown alone: it is seen as if it had been shown for long.
    """

    intrinsics: Intrinsics | None
    stamps_s: NDArray[np.float64]
    path: Trajectory | None = None
    earlier: "EarlierFrames | None" = None

    def motion(self, sequence: PlannedSequence, frame: int) -> CameraMotion | None:
        """Return how the camera moves at a frame of a sequence: its frames show the path's at an unchanged rate.

        Where the view has cut to another camera, that one is at rest: no camera flew from the one to the other.
        """
        if self.path is None:
            return None
        before = max(frame - 1, 0)
        rows = [int(sequence.source_frames[k]) for k in (0, before, frame)]
        if not self.path.known[rows].all():
            return None
        first, earlier, now = self.path.c2w[rows]
        cut = self.path.cuts_between(rows[1], rows[2])
        seconds = 0.0 if cut else float(self.path.stamps_s[frame] - self.path.stamps_s[before])
        return motion_between(first, earlier, now, seconds)


def cameras_of(render: "Render", paths: SensorPaths, earlier: "EarlierFrames | None" = None) -> CleanFrames:
    """Return the cameras of a render, without its clean frames. paths: the render's. earlier: as `Camera` has it."""
    source = render.scene.source
    colour = Camera(render.camera, source.stamps_s, paths.rgb, earlier)
    return CleanFrames(colour, Camera(render.depth_camera, source.frame_stamps.depth.seconds))


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from error


# The record of motion in frames.jsonl: which pose of the planned path a frame shows, and its deviation.


Float64: TypeAlias = NDArray[np.float64]


def motion_of_frames(render: "Render", sequence: PlannedSequence, paths: SensorPaths) -> list[dict[str, Any]]:
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


# Clean images of pairs of source frames, such as optical flow.


class OpenPairs:
    """The pairs that are to be made, and what is seen at those of their source frames that have been taken.

    What is seen is kept until its last pair is whole.
    """

    def __init__(self, wanted: Iterable[ShownSources], camera: Intrinsics) -> None:
        """Take the pairs; one without a next source frame is whole from its first on."""
        self._wanted = set(wanted)
        self._camera = camera
        self._views: dict[int, View] = {}

    @property
    def sources(self) -> set[int]:
        """The source frames that are still to be seen."""
        return {source for pair in self._wanted for source in pair if source is not None}

    def of(self, clean: CleanFrame, source: OpenSource, render: "Render", paths: SensorPaths) -> list[CleanPair]:
        """Take a clean frame of a render, whose source is open; return the pairs that are whole now."""
        view = partial(view_of, lambda: source, paths, clean, self._camera)
        return self.take(clean.source, view, partial(motion_of, source, render, paths))

    def take(
        self, source: int, view: Callable[[], View], motion: Callable[[int, int], Motion | None]
    ) -> list[CleanPair]:
        """Take what is seen at a source frame, where a pair needs it; return the pairs that are whole now.

        motion: returns how what is seen at two source frames moves from one to the other; None where nothing moves.
        """
        if any(source in pair and None not in pair for pair in self._wanted):
            self._views[source] = view()
        made: list[CleanPair] = []
        for here, there in sorted(self._wanted, key=lambda pair: pair[0]):
            if there is None and source == here:
                made.append(CleanPair((here, there), self._camera))
            elif there is not None and {here, there} <= self._views.keys():
                views = self._views[here], self._views[there]
                if (moves := motion(here, there)) is not None:
                    views = tuple(replace(item, to_other_px=px) for item, px in zip(views, moves, strict=True))
                made.append(CleanPair((here, there), self._camera, *views))
        self._wanted.difference_update(pair.shown for pair in made)
        for done in self._views.keys() - self.sources:
            del self._views[done]
        return made


def motion_of(source: OpenSource, render: "Render", paths: SensorPaths, here: int, there: int) -> Motion | None:
    """Return how what is seen at two source frames of a render moves from one to the other; None where nothing does."""
    if not render.scene.source.capabilities.moving:
        return None
    return motion_of_points(source, paths.request(here), paths.request(there))


def view_of(source: Callable[[], OpenSource], paths: SensorPaths, clean: CleanFrame, camera: Intrinsics) -> View:
    """Return what the colour camera sees at a source frame: where a rig has depth elsewhere, seen from colour's place.

    source: returns that of the render's frames. paths: of the render. clean: the source frame.
    """
    request = paths.request(clean.source)
    if paths.depth is None:
        return View(clean.read_depth_m(), request.rgb_c2w, camera)
    # By its time, as it is none of the frames that may be kept.
    seen = source().frame(replace(request, index=None, depth_c2w=request.rgb_c2w))
    assert seen.depth_m is not None, "depth was asked for"
    return View(seen.depth_m, request.rgb_c2w, camera)


# Colour where the reference alone does not do: on light, by what was shown before, in Blender's compositor.


Pictures: TypeAlias = dict[str, NDArray[Any] | None]
"""By a sequence's folder, its frame's image (H, W, 3); None where it is the clean one."""

Chains: TypeAlias = Mapping[str, tuple[Step[ColourPerturbation], ...]]
"""Steps of colour by the folder of their sequence, in propagation order."""


# --- Blender's compositor ---


class Compositing:
    """Steps of colour carried out by Blender's compositor, which works only in the main thread."""

    def __init__(self, compositor: "Compositor") -> None:
        """Take the compositor with a chain for each sequence's folder."""
        self._compositor = compositor

    def pictures(self, clean: CleanFrame, frames: Sequence[PlannedFrame]) -> dict[tuple[str, int], NDArray[Any] | None]:
        """Perturb all frames, several sequences in one evaluation; what several do alike is evaluated once."""
        made: dict[tuple[str, int], NDArray[Any] | None] = {}
        waiting = list(frames)
        while waiting:
            # A chain gives one image per evaluation; a sequence that shows the source frame twice takes another one.
            turn = {frame.sequence.folder: frame for frame in reversed(waiting)}
            waiting = [frame for frame in waiting if turn[frame.sequence.folder] is not frame]
            made |= {(folder, turn[folder].index): image for folder, image in self._turn(clean, turn).items()}
        return made

    def _turn(self, clean: CleanFrame, frames: Mapping[str, PlannedFrame]) -> Pictures:
        return self._perturbed(self._compositor, clean.rgb, clean, frames)

    @staticmethod
    def _perturbed(
        compositor: "Compositor", rgb: NDArray[Any], clean: CleanFrame, frames: Mapping[str, PlannedFrame]
    ) -> Pictures:
        """Return the frames' colour, rounded, after the chains of a compositor. rgb: encoded, what these are given."""
        made = compositor.perturb(rgb, *_inputs(clean, frames))
        return {folder: pixels for folder, (pixels, _) in made.items()}


class LitCompositing(Compositing):
    """The same on lit frames: on light before the view transform, and on what that shows after it.

    parts: the steps before it, and those after it. of_light: light itself is stored, so there are no steps after it.
    """

    def __init__(
        self, parts: tuple[Chains, Chains], compositors: "tuple[Compositor, Compositor]", of_light: bool
    ) -> None:
        self._of_light = of_light
        self._before, after = compositors
        super().__init__(after)
        self._early, self._late = parts

    def _turn(self, clean: CleanFrame, frames: Mapping[str, PlannedFrame]) -> Pictures:
        assert clean.light is not None, "its source is lit"
        early = {folder: frame for folder, frame in frames.items() if folder in self._early}
        lights, _ = self._before.evaluate(clean.light.rgb, *_inputs(clean, early))
        if self._of_light:
            return {folder: lights.get(folder) for folder in frames}
        shown = {id(light): clean.light.show(light) for light in lights.values() if light is not None}
        found: Pictures = {}
        for folder, frame in frames.items():
            seen = shown.get(id(lights.get(folder)))
            found[folder] = None if seen is None else rgb_bytes(seen)
            if folder in self._late:
                given = clean.rgb if seen is None else seen
                late = self._perturbed(self._compositor, given, clean, {folder: frame})[folder]
                found[folder] = found[folder] if late is None else late
        return found


def _inputs(clean: CleanFrame, frames: Mapping[str, PlannedFrame]) -> tuple[Any, ...]:
    """Return what a compositor is told of frames beside the image, by the folder of their sequence."""
    from ..nodes.chain import decided_by  # only Blender's compositor has groups

    needs_depth = any(frame.sequence.setting.needs_depth for frame in frames.values())
    return (
        {folder: (frame.index, frame.sequence.identifiers) for folder, frame in frames.items()},
        clean.read_seen_depth_m() if needs_depth else None,
        {folder: frame.motion for folder, frame in frames.items()},
        {folder: decided_by(frame.colour) for folder, frame in frames.items()},
    )


@contextmanager
def compositing(
    chains: Chains,
    clean: CleanFrames,
    size_px: tuple[int, int],
    *,
    lit: bool,
    of_light: bool,
    device: Literal["cpu", "gpu"],
    reference_width_px: int | None = None,
) -> Iterator[Compositing]:
    """Prepare Blender's compositor for some chains. clean, size_px and so on: as `colour_of` takes them."""
    from ..nodes.compositor import Compositor

    keep_freed_memory()
    made = partial(
        Compositor,
        size_px,
        reference_width_px=reference_width_px or size_px[0],
        intrinsics=clean.colour.intrinsics,
        device=device,
    )
    if not lit:
        with made(chains=chains) as compositor:
            yield Compositing(compositor)
        return
    before, after = parts = _parted(chains)
    with made(chains=before, lit=True) as of_lights, made(chains=after) as of_shown:
        yield LitCompositing(parts, (of_lights, of_shown), of_light)


def _parted(chains: Chains) -> tuple[Chains, Chains]:
    """Return each chain's steps before the sensor, and the others, of chains that have any."""
    parts: tuple[dict[str, tuple[Step[ColourPerturbation], ...]], ...] = ({}, {})
    for name, steps in chains.items():
        for part, early in zip(parts, (True, False), strict=True):
            if own := tuple(step for step in steps if step.perturbation.acts_on_light == early):
                part[name] = own
    return parts[0], parts[1]
