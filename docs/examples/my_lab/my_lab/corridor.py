# SPDX-License-Identifier: GPL-3.0-or-later
"""A corridor of striped walls, floor and ceiling, along which a camera sways."""

from dataclasses import dataclass

import numpy as np

from noisy_world.extend import (
    ComputedSource,
    FrameRequest,
    Intrinsics,
    RenderedFrame,
    SceneEntry,
    SceneKeys,
    SingleSceneKind,
    Trajectory,
    key,
)


@dataclass(frozen=True)
class Corridor:
    """What a preset says of a corridor."""

    width_m: float = key("from wall to wall, and from floor to ceiling", unit="m", default=4.0, above=0, maximum=100)
    frames: int = key("length of the path", unit="frames", default=20, minimum=1, maximum=10_000)


@dataclass(frozen=True, kw_only=True)
class CorridorKeys(SceneKeys):
    """The keys of such a scene: a name, and the corridor."""

    corridor: Corridor = key("instead of mesh: a corridor without an end")


@dataclass(frozen=True)
class CorridorSource(ComputedSource):
    """A corridor along z, around the origin."""

    corridor: Corridor
    location = "a corridor"

    def trajectory(self) -> Trajectory:
        """Return the path: forwards, and from side to side."""
        steps = np.arange(self.corridor.frames)
        c2w = np.tile(np.eye(4), (len(steps), 1, 1))
        c2w[:, 0, 3], c2w[:, 2, 3] = self.corridor.width_m / 10 * np.sin(steps), 0.05 * steps
        return Trajectory(c2w, steps / 20)

    def hashes(self) -> dict[str, str]:
        """Return nothing: no file decides what it shows."""
        return {}

    def frame(self, request: FrameRequest, camera: Intrinsics) -> RenderedFrame:
        """Return stripes across the way, and depth."""
        _, z_m = self._seen(request.rgb_c2w, camera)
        depth_m, _ = self._seen(request.depth_c2w, camera)
        rgb = 0.5 + 0.5 * np.sin(z_m[..., None] * [3.0, 4.0, 5.0])
        return RenderedFrame(rgb.astype(np.float32), depth_m.astype(np.float32))

    def _seen(self, c2w: np.ndarray, camera: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
        """Return planar depth of each pixel, at most 100 m, and the world's z of what it sees."""
        row, column = np.mgrid[: camera.height_px, : camera.width_px]
        x, y = (column - camera.cx_px) / camera.fx_px, (row - camera.cy_px) / camera.fy_px
        directions = np.stack([x, y, np.ones_like(x)], axis=-1) @ c2w[:3, :3].T
        across = directions[..., :2] + 1e-9  # no ray is parallel to a wall
        ahead_m = np.sign(across) * self.corridor.width_m / 2 - c2w[:2, 3]
        depth_m = np.minimum((ahead_m / across).min(axis=-1), 100.0)
        return depth_m, c2w[2, 3] + depth_m * directions[..., 2]


class CorridorKind(SingleSceneKind[CorridorKeys]):
    """Corridors of any width."""

    name = "corridor"
    label = "Corridor"
    meaning = "a corridor of striped walls, along which a camera sways"
    keys = CorridorKeys

    def open(self, entry: SceneEntry[CorridorKeys]) -> CorridorSource:
        """Return the source of a preset's scene."""
        return CorridorSource(entry.keys.corridor)


SOURCE = CorridorKind()
