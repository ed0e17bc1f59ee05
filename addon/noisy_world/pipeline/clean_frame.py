# SPDX-License-Identifier: GPL-3.0-or-later
"""A clean frame on its way to the files: its images, decoded once, and the context that perturbations get."""

import contextlib
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.image_files import WholeFile
from ..core.datasets.images import as_bytes, as_float
from ..core.datasets.layouts import Modality, OutputFormat
from ..core.datasets.registration import Registration
from ..core.datasets.unmeasured import completed_m
from ..core.geometry import Intrinsics
from ..core.perturbing.earlier_frames import EarlierFrame
from ..core.perturbing.execution import ColourWork, DepthWork
from ..core.perturbing.lit import acts_on_light, after_light, on_light
from ..core.planning.metering import light_seen
from ..core.planning.plan import Render
from ..core.planning.sequence import PlannedSequence, ShownSources
from ..core.planning.source import SceneLight, SourceFrame
from ..core.trajectories.motion import CameraMotion, motion_between
from ..core.trajectories.sensor_paths import SensorPaths
from ..core.trajectories.trajectory import Trajectory
from .earlier import EarlierFrames
from .made_frame import CleanFrames
from .stage_timer import DECODING, StageTimer

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
