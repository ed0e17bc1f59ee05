# SPDX-License-Identifier: GPL-3.0-or-later
"""Stands in for noisy_world.blender.session where a test is about files: frames from arithmetic, at once."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np


@dataclass(frozen=True)
class RenderOptions:
    near_m: float
    far_m: float
    samples: int
    seed: int
    engine: str = "cycles"
    device: str = "cpu"
    rgb: bool = True
    depth: bool = True
    threads: int = 0


def renderer_versions(engine, device="cpu"):
    return {"blender": "none"}


class Session:
    rendered: list[int] = []

    def __init__(self, mesh, name, trajectories, intrinsics, options):
        self.origin_m = np.zeros(3)
        self._options = options
        self._shape = (intrinsics.height_px, intrinsics.width_px)

    def render(self, frame):
        Session.rendered.append(frame)
        ramp = np.linspace(0, 1, self._shape[0] * self._shape[1], dtype=np.float32).reshape(self._shape)
        rgb = np.stack([ramp, 1 - ramp, np.full_like(ramp, frame / 255)], axis=-1)
        depth_m = 1 + ramp + np.float32(frame)
        return SimpleNamespace(rgb=rgb if self._options.rgb else None, depth_m=depth_m if self._options.depth else None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass
