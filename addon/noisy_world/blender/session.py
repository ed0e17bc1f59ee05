# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene with its cameras keyed, ready to give any frame: what the generator renders from."""

from collections.abc import Mapping
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ..core.mesh import Mesh
from ..core.trajectory import Trajectory
from .camera import add_camera, key_trajectory, set_intrinsics
from .render import FrameRenderer, RenderedFrame, configure_cycles, filter_offset_px
from .scene import add_mesh, empty_scene, set_origin

# Up to here float32 resolves 1e-6 m, and a scene keeps its own coordinates, as an artist would find them.
RECENTRE_BEYOND_M = 16.0


@dataclass(frozen=True)
class RenderOptions:
    """How to render. threads 0: as many as the machine has."""

    near_m: float
    far_m: float
    samples: int
    seed: int
    threads: int = 0


def blender_version() -> str:
    """Return Blender's version and build."""
    return f"{bpy.app.version_string} {bpy.app.build_hash.decode(errors='replace')}"


def recentring_m(trajectory: Trajectory) -> NDArray[np.float64]:
    """Return the point (3,) float64, metres, to render around: whole metres in the middle of the path, if far away.

    Near the camera is where precision counts, so it is the path that decides and not the mesh.
    """
    positions_m = trajectory.c2w[:, :3, 3]
    middle_m = np.rint((positions_m.min(axis=0) + positions_m.max(axis=0)) / 2)
    return middle_m if np.abs(positions_m).max() > RECENTRE_BEYOND_M else np.zeros(3)


class Session:
    """One scene in Blender, from its first frame to its last. Blender holds one scene, so use one after another."""

    def __init__(
        self,
        mesh: Mesh,
        name: str,
        trajectories: Mapping[str, Trajectory],
        intrinsics: Intrinsics,
        options: RenderOptions,
    ) -> None:
        """Build the scene.

        trajectories: "" is the colour camera's; "depth" the depth sensor's, where it is elsewhere.
        """
        self._scene = scene = empty_scene()
        self._samples = options.samples
        self.origin_m = recentring_m(trajectories[""])
        set_origin(scene, self.origin_m)
        # A single sample is averaged with nothing, so its colour need not become light and colour again.
        linear_light = options.samples > 1
        add_mesh(scene, mesh, name, decode_colours=linear_light)
        configure_cycles(scene, seed=options.seed, threads=options.threads)
        self._cameras = {
            sensor: self._keyed_camera(
                f"Noisy World camera {sensor}".strip(), trajectories[sensor].c2w, intrinsics, options
            )
            for sensor in ("", "depth")
            if sensor in trajectories
        }
        # Two sensors are seen through one camera that stands in for each in turn: another scene camera costs a frame's
        # time, another place nothing.
        self._eye = None if len(self._cameras) == 1 else self._camera("Noisy World eye", intrinsics, options)
        scene.camera = self._eye or self._cameras[""]
        self._renderer = FrameRenderer(
            scene,
            (intrinsics.width_px, intrinsics.height_px),
            rgb=True,
            depth=True,
            samples=options.samples,
            encoded_colours=not linear_light,
        )

    def _camera(self, name: str, intrinsics: Intrinsics, options: RenderOptions) -> bpy.types.Object:
        camera = add_camera(self._scene, name)
        set_intrinsics(
            self._scene,
            camera,
            intrinsics,
            near_m=options.near_m,
            far_m=options.far_m,
            sample_offset_px=filter_offset_px(options.samples),
        )
        return camera

    def _keyed_camera(
        self, name: str, c2w: NDArray[np.float64], intrinsics: Intrinsics, options: RenderOptions
    ) -> bpy.types.Object:
        camera = self._camera(name, intrinsics, options)
        key_trajectory(self._scene, camera, c2w)
        return camera

    def render(self, frame: int) -> RenderedFrame:
        """Render a frame of the trajectories, counted from 0: colour and depth."""
        self._scene.frame_set(frame)
        if self._eye is None:
            return self._renderer.render()
        colour = self._render_from("", self._samples)
        depth = self._render_from("depth", 1)
        return RenderedFrame(colour.rgb, depth.depth_m)

    def _render_from(self, sensor: str, samples: int) -> RenderedFrame:
        assert self._eye is not None
        self._eye.location = self._cameras[sensor].location
        self._eye.rotation_quaternion = self._cameras[sensor].rotation_quaternion
        self._scene.cycles.samples = samples
        return self._renderer.render()

    def close(self) -> None:
        """Remove the scratch files."""
        self._renderer.close()

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
