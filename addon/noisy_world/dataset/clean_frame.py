# SPDX-License-Identifier: GPL-3.0-or-later
"""A clean frame on its way to the files: its images and light, what came before it, and pairs of such frames."""

import contextlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS
from ..channels.channel import PairChannel, View
from ..core.camera_motion import CameraMotion, motion_between
from ..core.frame_request import SensorPaths
from ..core.geometry import Intrinsics
from ..core.srgb import decoded, encoded
from ..core.trajectory import Trajectory
from ..images.image_files import WholeFile
from ..images.measured_depth import Registration, completed_m
from ..images.pixels import as_bytes, as_float
from ..layouts import Modality, OutputFormat
from ..perturbations.as_nodes import as_nodes
from ..perturbations.execution import ColourWork, DepthWork, on_encoded, perturb_colour
from ..perturbations.kinds import MID_GREY, ColourPerturbation, EarlierFrame, FrameContext, ReadEarlier, earlier_than
from ..perturbations.steps import Step
from ..render.source import Motion, OpenSource, SceneLight, SourceFrame, light_seen
from ..render.source import motion_between as pairs_motion_between
from .frame import CleanFrames
from .plan import Render
from .run_report import DECODING, StageTimer
from .sequence import PlannedSequence, ShownSources

# Steps of colour on lit frames: some on scene-linear light, the rest on what a view transform shows of it.


def acts_on_light(work: ColourWork) -> bool:
    """Tell whether a step acts on light, so before the view transform."""
    return any(step.perturbation.acts_on_light for step, _, _ in work.active)


def on_light(work: ColourWork, rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    """Do what acts on light to scene-linear light (H, W, 3), of any brightness; return light."""
    for step, context, severity in work.active:
        if step.perturbation.acts_on_light:
            rgb = perturb_light(step, rgb, severity, context)
    return rgb


def after_light(work: ColourWork, shown: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Do the rest to what the view transform has made of `on_light`: (H, W, 3), display-encoded in [0, 1]."""
    return on_encoded(tuple(item for item in work.active if not item[0].perturbation.acts_on_light), shown)


def perturb_light(
    step: Step[ColourPerturbation], light: NDArray[np.float32], severity: float | None, context: FrameContext
) -> NDArray[np.float32]:
    """Carry out one step on scene-linear light (H, W, 3) float32, of any brightness; the result is at least 0.

    Some carry out their node group. What only averages works on light itself; the others as ever, on encoded values, by
    sRGB's curve, which goes on above 1.
    """
    context = replace(context, lit=True)
    if step.perturbation.lit_by_nodes:
        made = as_nodes(step.perturbation, light, step.parameters(severity), context)
    elif step.perturbation.averages:
        made = perturb_colour(step, light, severity, context)
    else:
        made = decoded(perturb_colour(step, encoded(light), severity, context))
    return np.maximum(made, np.float32(0))


# Earlier frames of a sequence, small, for steps of colour that look back: kept while they may be asked for again.


KEPT = 4096  # small images: 36 MiB at most, more than any frame of 60 Hz looks back; chosen


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


SKY_BEHIND_GLASS_M = 500.0  # as far away as haze, rain and snow take the sky to be
OUTDOORS = 0.02  # share of open sky from which on that holds; less counts in part, so that nothing jumps; chosen


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

    @classmethod
    def of(
        cls,
        render: Render,
        source: int,
        image: SourceFrame,
        timer: StageTimer | None = None,
        *,
        of_light: bool = False,
    ) -> "CleanFrame":
        """Return a source frame of a render."""
        unmeasured_m = render.scene.source.capabilities.unmeasured_m
        between, registers = render.registration, render.registers
        return cls(source, image, between, timer, of_light=of_light, registers=registers, unmeasured_m=unmeasured_m)

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
            return on_light(work, light.rgb) if work.active else None
        if acts_on_light(work):
            return after_light(work, light.show(on_light(work, light.rgb)))
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
    earlier: EarlierFrames | None = None

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


def cameras_of(render: Render, paths: SensorPaths, earlier: EarlierFrames | None = None) -> CleanFrames:
    """Return the cameras of a render, without its clean frames. paths: the render's. earlier: as `Camera` has it."""
    source = render.scene.source
    colour = Camera(render.camera, source.stamps_s, paths.rgb, earlier)
    return CleanFrames(colour, Camera(render.depth_camera, source.frame_stamps.depth.seconds))


# Clean images of pairs of source frames, such as optical flow.


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


def motion_of(source: OpenSource, render: Render, paths: SensorPaths, here: int, there: int) -> Motion | None:
    """Return how what is seen at two source frames of a render moves from one to the other; None where nothing does."""
    if not render.scene.source.capabilities.moving:
        return None
    return pairs_motion_between(source, paths.request(here), paths.request(there))


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
