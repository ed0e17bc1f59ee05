# SPDX-License-Identifier: GPL-3.0-or-later
"""Which settings are the same whatever the seed, so that one seed is enough: found by trying it."""

import numpy as np
from numpy.typing import NDArray

from ...core.channels import COLOUR_AND_DEPTH
from ...core.geometry import Intrinsics
from ...core.perturbing.contexts import Identifiers
from ...core.perturbing.execution import move, split_motion
from ...core.perturbing.steps import Setting
from ...core.planning.scene import Scene
from ...core.planning.sequence import lay_out
from ...core.planning.source import RenderedFrame
from ...pipeline.clean_frame import Camera, CleanFrame
from ...pipeline.made_frame import CleanFrames, Frame

PROBED_FRAMES = 12  # of which a severity that is drawn differs somewhere but in one of 10^8 cases
PROBE_PX = (64, 48)


def depends_on_seed(setting: Setting, scene: Scene, seeds: tuple[int, int], *, renders_by_seed: bool) -> bool:
    """Tell whether a sequence is another with another seed.

    Motion and pairing are compared as they are, what is done to images on small ones with edges, near and far, and
    void. renders_by_seed: whether the renderer's samples follow the seed, so that every frame does.
    """
    if renders_by_seed:
        return True
    one, other = ((seed, scene.name, setting.name) for seed in seeds)
    return _motion_differs(setting, scene, one, other) or _images_differ(setting, one, other)


def _motion_differs(setting: Setting, scene: Scene, one: Identifiers, other: Identifiers) -> bool:
    laid = [lay_out(setting, scene.name, scene.frame_count, identifiers) for identifiers in (one, other)]
    if (laid[0].source_frames, laid[0].depth_frames) != (laid[1].source_frames, laid[1].depth_frames):
        return True
    moving, _ = split_motion(setting.motion, exposed=bool(setting.exposure))
    if not moving:
        return False
    path = scene.path
    return not np.array_equal(move(moving, path, one).c2w, move(moving, path, other).c2w)


def _images_differ(setting: Setting, one: Identifiers, other: Identifiers) -> bool:
    if not (setting.rgb or setting.depth):
        return False
    rgb, depth_m = _probe()
    width_px, height_px = PROBE_PX
    camera = Intrinsics(width_px, height_px, width_px, width_px, (width_px - 1) / 2, (height_px - 1) / 2)
    seen = Camera(camera, np.arange(PROBED_FRAMES) / 20)
    clean = CleanFrames(seen, seen).of_one(CleanFrame(0, RenderedFrame(rgb, depth_m)))
    by_reference = Setting(setting.name, (*setting.rgb, *setting.depth))
    laid = [lay_out(by_reference, "", PROBED_FRAMES, identifiers) for identifiers in (one, other)]
    for index in range(PROBED_FRAMES):
        frames = [Frame(sequence, index, clean) for sequence in laid]
        if not all(_equal(*(frame.changed(channel) for frame in frames)) for channel in COLOUR_AND_DEPTH):
            return True
    return False


def _equal(left: NDArray[np.generic] | None, right: NDArray[np.generic] | None) -> bool:
    if left is None or right is None:
        return left is right
    return np.array_equal(left, right, equal_nan=left.dtype.kind == "f")


def _probe() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return colour (H, W, 3) in [0, 1] and depth (H, W) in metres: ramps with edges, from near to far, and void."""
    width_px, height_px = PROBE_PX
    across, down = np.meshgrid(np.linspace(0, 1, width_px), np.linspace(0, 1, height_px))
    steps = (np.floor(6 * across) + np.floor(4 * down)) % 2
    rgb = np.stack([across, down, 0.25 + 0.5 * steps], axis=-1).astype(np.float32)
    depth_m = (0.2 + 6.0 * across + 1.5 * steps).astype(np.float32)
    depth_m[-4:] = 0.0
    return rgb, depth_m
