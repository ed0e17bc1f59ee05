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
from .render import FrameRenderer, RenderedFrame, configure_cycles
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
        scene = empty_scene()
        configure_cycles(scene, seed=options.seed, threads=options.threads)
        self.origin_m = recentring_m(trajectories[""])
        set_origin(scene, self.origin_m)
        # A single sample is averaged with nothing, so its colour need not become light and colour again.
        linear_light = options.samples > 1
        add_mesh(scene, mesh, name, decode_colours=linear_light)
        self._cameras = {}
        for sensor in ("", "depth"):
            if sensor in trajectories:
                camera = add_camera(scene, f"Noisy World camera {sensor}".strip())
                set_intrinsics(scene, camera, intrinsics, near_m=options.near_m, far_m=options.far_m)
                key_trajectory(scene, camera, trajectories[sensor].c2w)
                self._cameras[sensor] = camera
        self._renderer = FrameRenderer(
            scene,
            width_px=intrinsics.width_px,
            height_px=intrinsics.height_px,
            samples=options.samples,
            encoded_colours=not linear_light,
        )

    def render(self, frame: int) -> RenderedFrame:
        """Render a frame of the trajectories, counted from 0: colour and depth."""
        if "depth" not in self._cameras:
            return self._renderer.render(self._cameras[""], frame, rgb=True, depth=True)
        colour = self._renderer.render(self._cameras[""], frame, rgb=True, depth=False)
        depth = self._renderer.render(self._cameras["depth"], frame, rgb=False, depth=True)
        return RenderedFrame(colour.rgb, depth.depth_m)

    def close(self) -> None:
        """Remove the scratch files."""
        self._renderer.close()

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
