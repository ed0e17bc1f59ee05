# SPDX-License-Identifier: GPL-3.0-or-later
"""Opens the renderer of a mesh: Blender, or Embree."""

from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.bending import Bending, overscanned
from ..core.geometry import Intrinsics
from ..core.optics import Distortion
from ..core.planning.source import RenderedFrame, RenderOptions
from ..core.scenes.mesh import Mesh
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths
from .bending import BentSession
from .rectification import Rectification


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
        from ..rays.session import RaySession

        return RaySession(mesh, paths, camera, options, lens)
    from ..blender.session import Session

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
