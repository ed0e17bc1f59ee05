# SPDX-License-Identifier: GPL-3.0-or-later
"""Opening a mesh's renderer, the lens that a preset asks for, registered depth, and checks of the first frames."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, Message, PresetKey
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics
from ..core.lens import Bending, Distortion, Optics, overscanned
from ..core.schema import ConfigPath
from ..images.measured_depth import Registration
from ..preset.keys import Preset
from ..preset.sensor_keys import DistortionSpec, sound_lens
from ..render.source import RenderedFrame, RenderOptions, SourceFrame, surfaces_bent
from ..scenes.polygon_mesh import Mesh

# The lens that a preset asks for, and sessions of renderers that know pinholes alone, bent as it does.


MOST_TIMES = 16.0  # as many pixels as the image has may be rendered for it; chosen


def lens_of(spec: DistortionSpec, camera: Intrinsics, place: ConfigPath, *, cast: bool) -> Distortion:
    """Return the lens that a mesh is seen through. cast: whether rays are cast through it, rather than a pinhole bent.

    Raises InputError where it folds over within the image, or a pinhole would take too long to render.
    """
    lens = sound_lens(spec, camera, place, all_around=cast)
    if cast:
        return lens
    pinhole = overscanned(camera, lens)
    times = pinhole.width_px * pinhole.height_px / (camera.width_px * camera.height_px)
    if times > MOST_TIMES:
        size = f"{pinhole.width_px} x {pinhole.height_px} px, {times:.0f} times the image"
        raise place.error(f"needs a pinhole's {size}", Message("use ", PresetKey("render.engine", "embree")))
    return lens


def check_light_lens(preset: Preset) -> None:
    """Refuse to undistort what is lit, whose light before its view transform is bent alone. Raises InputError."""
    camera = preset.spec.camera
    if camera is not None and camera.distortion is not None and camera.distortion.undistort:
        place = preset.place("camera").at("distortion").at("undistort")
        raise place.error("is true, but light before a view transform is not undistorted", "leave it out")


@dataclass
class BentSession:
    """A session of a renderer that knows pinholes alone, whose frames are bent as a lens does.

    session: of the pinhole of `bending`. own_depth: whether depth is of a camera of its own. origin_m: (3,) float64,
    around which it is rendered. notes: what a user should know about how it is rendered.
    """

    session: Any
    bending: Bending
    own_depth: bool = False
    origin_m: NDArray[np.float64] = field(init=False)
    notes: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        pinhole = self.bending.pinhole
        size = f"{pinhole.width_px} x {pinhole.height_px}"
        said = f"rendered as a pinhole's {size} px, and bent as the lens does: interpolated"
        self.origin_m, self.notes = self.session.origin_m, (*self.session.notes, said)

    def serves(self, paths: SensorPaths, options: RenderOptions) -> bool:
        """Tell whether frames along other paths, with other options, would be those of a session of their own."""
        return self.session.serves(paths, options)

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Render a frame, and bend it."""
        frame = self.session.frame(request)
        coloured = replace(frame, rgb=None if frame.rgb is None else self.bending.rgb(frame.rgb))
        return surfaces_bent(coloured, self.bending, own_depth=self.own_depth)

    def __enter__(self) -> "BentSession":
        self.session.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.session.__exit__(*error)


# Rectification of a recording's frames before they are perturbed: undistorted, and depth registered to colour.


@dataclass(frozen=True)
class Rectification:
    """Undistorts, registers and bends frames. camera: of colour. optics: of the recording, before it is done.

    bent: the lens that frames are shown through in the end; None for none.
    """

    camera: Intrinsics
    optics: Optics
    undistort: bool = False
    register: bool = False
    bent: Distortion | None = None

    @property
    def does_nothing(self) -> bool:
        """Whether frames stay as they are."""
        return self._lens is None and self._between is None and self.bent is None

    @property
    def left(self) -> Optics:
        """What the cameras of treated frames have beyond one pinhole."""
        left = replace(self.optics, distortion=None) if self.undistort else self.optics
        left = replace(left, depth=None) if self.register else left
        if left.depth is not None and self.undistort:
            left = replace(left, depth=replace(left.depth, shares_lens=False))
        return left if self.bent is None else replace(left, distortion=self.bent)

    def rgb(self, rgb: NDArray[Any]) -> NDArray[Any]:
        """Return colour (H, W, 3) of the type given. What the lens did not see is black."""
        import cv2

        if self._lens is not None:
            rgb = np.asarray(cv2.remap(rgb, *self._colour_maps, cv2.INTER_LINEAR), rgb.dtype)
        return rgb if self._bending is None else self._bending.rgb(rgb)

    def depth_m(self, depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return planar depth (H, W) in metres, 0 = void; of the nearest pixel, but for what is bent."""
        import cv2

        if self._lens is not None and (self.optics.depth is None or self.optics.depth.shares_lens):
            # Depths are not averaged: between two surfaces there is nothing.
            depth_m = np.asarray(cv2.remap(depth_m, *self._depth_maps, cv2.INTER_NEAREST), np.float32)
        if self._between is not None:
            depth_m = self._between.depth_in_colour(depth_m)
        return depth_m if self._bending is None else self._bending.depth_m(depth_m)

    @cached_property
    def _bending(self) -> Bending | None:
        return None if self.bent is None else Bending(self.camera, self.camera, self.bent)

    @cached_property
    def _lens(self) -> Distortion | None:
        return self.optics.distortion if self.undistort else None

    @cached_property
    def _between(self) -> Registration | None:
        if not self.register or self.optics.depth is None:
            return None
        left = None if self.undistort else self.optics.distortion
        return Registration(self.camera, self.optics.depth, left)

    @cached_property
    def _colour_maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        return _maps(self.camera, self._lens)

    @cached_property
    def _depth_maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        seen = self.camera if self.optics.depth is None else self.optics.depth.intrinsics
        return _maps(seen, self._lens)


def _maps(camera: Intrinsics, lens: Distortion | None) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return where each pixel of a pinhole of the same intrinsics is in the distorted image, x and y (H, W)."""
    assert lens is not None, "asked for by who has one"
    rays = camera.ray_directions()
    x, y = lens.bent(rays[..., 0], rays[..., 1])
    across, down = x * camera.fx_px + camera.cx_px, y * camera.fy_px + camera.cy_px
    return across.astype(np.float32), down.astype(np.float32)


class RenderSession(Protocol):
    """A mesh in a renderer, ready to be seen from any pose.

    origin_m: (3,) float64, around which it is rendered. notes: what a user should know about how that is done.
    """

    origin_m: NDArray[np.float64]
    notes: tuple[str, ...]

    def serves(self, paths: SensorPaths, options: RenderOptions) -> bool:
        """Tell whether frames along other paths, with other options, would be those of a session of their own."""
        ...

    def frame(self, request: FrameRequest) -> RenderedFrame:
        """Render a frame."""
        ...


def open_session(
    mesh: Mesh,
    name: str,
    paths: SensorPaths,
    camera: Intrinsics,
    options: RenderOptions,
    *,
    lens: Distortion | None = None,
) -> AbstractContextManager[RenderSession]:
    """Hand a mesh to the renderer that the options ask for. lens: that distorts; a pinhole's frames are bent for it.

    Raises MissingDependencyError where the renderer cannot run here.
    """
    if options.engine == "embree":
        from ..render.ray_session import RaySession

        return RaySession(mesh, paths, camera, options, lens)
    from ..render.mesh_session import Session

    if lens is None:
        return Session(mesh, name, paths, camera, options)
    bending = Bending(overscanned(camera, lens), camera, lens)
    session = Session(mesh, name, paths, bending.pinhole, options)
    return BentSession(session, bending, own_depth=options.depth_camera is not None)


def undistorted(frame: RenderedFrame, rectified: Rectification, *, own_depth: bool = False) -> RenderedFrame:
    """Return the colour and depth of a frame that passed a lens as a pinhole's.

    own_depth: whether depth is another camera's, which has no lens.
    """
    rgb = None if frame.rgb is None else rectified.rgb(frame.rgb)
    depth_m = frame.depth_m if own_depth or frame.depth_m is None else rectified.depth_m(frame.depth_m)
    behind_m = None if frame.behind_glass_m is None else rectified.depth_m(frame.behind_glass_m)
    return RenderedFrame(rgb, depth_m, colour_rays=frame.colour_rays, behind_glass_m=behind_m)


# Checks the first frames of a rendered path: if they see nothing, the path is taken for a mistake.


@dataclass(frozen=True)
class Beginning:
    """The first moments of a path, at least one, and the error if none of them sees anything."""

    requests: tuple[FrameRequest, ...]
    error: InputError


def beginning_of(
    paths: SensorPaths, frames: tuple[int, ...], path: str, *, unseen: str, place: ConfigPath, remedy: str
) -> Beginning | None:
    """Return what a path must not begin with, None where no frame is looked at.

    path, unseen: for the message, such as "nothing of room.ply". place: in the preset. remedy: beside going on.
    """
    if not frames:
        return None
    those = f"frame {frames[0]}" if len(frames) == 1 else f"frames {frames[0]} to {frames[-1]}"
    problem = f"{those} of {path} see{'s' * (len(frames) == 1)} {unseen}"
    error = place.error(problem, f"{remedy}, or go on with render.allow_empty: true")
    return Beginning(tuple(map(paths.request, frames)), error)


def check_beginning(
    beginning: Beginning, request: FrameRequest, frame: SourceFrame, render: Callable[[FrameRequest], SourceFrame]
) -> None:
    """Raise the error where none of the first frames sees anything.

    request, frame: what was rendered first. Frames that another process writes, or none, are rendered for this alone,
    so that each process of a run comes to the same end, before it has handed out a frame.
    """
    first, *others = beginning.requests
    if _sees_something(frame if request.index == first.index else render(first)):
        return
    if not any(_sees_something(render(other)) for other in others):
        raise beginning.error


def _sees_something(frame: SourceFrame) -> bool:
    """Tell whether a frame shows anything: void has no depth, and nothing to say by colour but a sky, if any."""
    image = frame.rgb if frame.depth_m is None else frame.depth_m
    return image is not None and bool(image.any())
