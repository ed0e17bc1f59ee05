# SPDX-License-Identifier: GPL-3.0-or-later
"""Errors of saved frames: colour against a reference of many samples, depth against cast rays."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.core.datasets.images import rgb_bytes

EDGE_JUMP = 0.05  # of the nearer depth, between neighbours
EDGE_REACH_PX = 2
WRONG_SURFACE = 0.01  # of the depth: at an edge, what is farther off shows another surface


def rgb_errors(folder: Path, reference: Path, frames: list[int]) -> dict[str, float]:
    """Return mean PSNR (dB) and SSIM of 8-bit colours against the reference's."""
    psnr, ssim = [], []
    for frame in frames:
        mine, other = (rgb_bytes(np.load(place / f"{frame}.npz")["rgb"]) for place in (folder, reference))
        psnr.append(cv2.PSNR(mine, other))
        ssim_of = cv2.quality.QualitySSIM_compute  # pyright: ignore[reportAttributeAccessIssue]  not in OpenCV's stubs
        similarity, _ = ssim_of(mine, other)
        ssim.append(float(np.mean(similarity[:3])))
    return {"psnr_db": float(np.mean(psnr)), "ssim": float(np.mean(ssim))}


def cast_errors(folder: Path, truth: Path, frames: list[int]) -> dict[str, float]:
    """Return relative errors of depth against the rays' (off edges: largest, 99.9 %; at edges: wrong surfaces)."""
    off, at, void = [], [], []
    share = []
    for frame in frames:
        depth_m = np.load(folder / f"{frame}.npz")["depth_m"].astype(np.float64)
        true_m = np.load(truth / f"{frame}.npy")
        edge = edges(true_m)
        both = (depth_m > 0) & (true_m > 0)
        error = np.abs(np.where(both, depth_m, 1.0) / np.where(both, true_m, 1.0) - 1)
        off.append(error[both & ~edge])
        at.append(error[both & edge])
        void.append(((depth_m > 0) != (true_m > 0)).mean())
        share.append(edge.mean())
    off_all, at_all = np.concatenate(off), np.concatenate(at)
    return {
        "off_median": float(np.median(off_all)),
        "off_p999": float(np.quantile(off_all, 0.999)),
        "off_beyond_2e-4": float((off_all > 2e-4).mean()),
        "edge_share": float(np.mean(share)),
        "edge_median": float(np.median(at_all)),
        "edge_wrong_surface": float((at_all > WRONG_SURFACE).mean()),
        "void_differs": float(np.mean(void)),
    }


def edges(depth_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark (H, W) what lies within EDGE_REACH_PX of a jump of depth or a border of void."""
    jump = np.zeros(depth_m.shape, bool)
    for axis in (0, 1):
        a, b = np.moveaxis(depth_m, axis, 0)[:-1], np.moveaxis(depth_m, axis, 0)[1:]
        step = np.abs(a - b) > EDGE_JUMP * np.minimum(a, b)
        view = np.moveaxis(jump, axis, 0)
        view[:-1] |= step
        view[1:] |= step
    size = 2 * EDGE_REACH_PX + 1
    return cv2.dilate(jump.astype(np.uint8), np.ones((size, size), np.uint8)).astype(bool)
