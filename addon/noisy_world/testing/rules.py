# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of contracts, and the small scene that they are tested on."""

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.geometry import Intrinsics
from ..core.trajectories.trajectory import Trajectory

WIDTH_PX, HEIGHT_PX = 48, 36
CAMERA = Intrinsics(WIDTH_PX, HEIGHT_PX, 40.0, 42.0, 23.5, 17.5)
NAME = r"[a-z][a-z0-9_]*"


def require(kept: Any, name: str, rule: str) -> None:
    """Raise AssertionError, `name: rule`, where a rule is not kept."""
    if not kept:
        raise AssertionError(f"{name}: {rule}")


def require_name(name: Any) -> None:
    """Require that this is a name that presets, options and tables can have."""
    require(isinstance(name, str) and re.fullmatch(NAME, name), str(name), "is no name: small letters, digits and _")


def images(frame: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return colour (H, W, 3) float32 in [0, 1] and planar depth (H, W) float32, metres, a part of it void (0)."""
    row, column = np.mgrid[:HEIGHT_PX, :WIDTH_PX].astype(np.float32)
    waves = np.stack([np.sin(row / 3 + frame), np.cos(column / 4), np.sin((row + column) / 5)], axis=-1)
    depth_m = 1.0 + row / 20 + column / 30 + 0.01 * np.float32(frame)
    depth_m[:6, :8] = 0.0
    return (0.5 + 0.5 * waves).astype(np.float32), depth_m.astype(np.float32)


def path(frames: int) -> Trajectory:
    """Return a path that walks and turns; its stamps are no multiples of anything: nobody can count them."""
    turn = np.linspace(0.0, 0.5, frames)
    c2w = np.tile(np.eye(4), (frames, 1, 1))
    c2w[:, 0, 0], c2w[:, 0, 2], c2w[:, 2, 0], c2w[:, 2, 2] = np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)
    steps = np.arange(frames)
    c2w[:, :3, 3] = np.stack([0.1 * steps, 0.02 * np.sin(steps), 0.05 * steps + 0.01 * steps**2], axis=1)
    return Trajectory(c2w, 10.0 + 0.05 * steps + 0.001 * (steps % 3))
