# SPDX-License-Identifier: GPL-3.0-or-later
"""A map as the true cameras would see it, against what they see: depth and colour."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.scenes.mesh import Mesh
from .views import Views, rendered_views, spread

MOST_RENDERS = 50
HIGHEST_PSNR_DB = 100.0  # of equal images, whose PSNR has no bound; chosen

Colour: TypeAlias = NDArray[np.uint8]
Compare: TypeAlias = Callable[[Colour, Colour], float]
"""A number for two images (H, W, 3) uint8 RGB, such as LPIPS."""


@dataclass(frozen=True)
class Rendered:
    """What renders of a map and of the truth say; None for what nothing says. Means of colour are over images.

    depth_l1_m: the mean difference where both see something. depth_share: of the true pixels, where the map is seen.
    """

    depth_l1_m: float | None
    depth_share: float | None
    psnr_db: float | None
    ssim: float | None
    lpips: float | None


def compare_renders(mesh: Mesh, views: Views, *, lpips: Compare | None = None) -> Rendered:
    """Compare at most MOST_RENDERS renders of a mesh, evenly chosen, with the true ones; it lies as the truth does.

    Colour is compared over whole images, where the map has colours: void is black.
    """
    chosen = spread(len(views.c2w), MOST_RENDERS)
    error_m, both, true_pixels = 0.0, 0, 0
    of_colour: dict[str, list[float]] = {"psnr_db": [], "ssim": [], "lpips": []}
    with rendered_views(mesh, views.camera, views.c2w) as mapped:
        for index in chosen:
            true, seen = views.view(index), mapped.view(index)
            there = true.depth_m > 0
            common = there & (seen.depth_m > 0)
            error_m += float(np.abs(true.depth_m - seen.depth_m)[common].sum(dtype=np.float64))
            both, true_pixels = both + int(common.sum()), true_pixels + int(there.sum())
            if true.rgb is not None and seen.rgb is not None:
                of_colour["psnr_db"].append(psnr_db(true.rgb, seen.rgb))
                of_colour["ssim"].append(ssim(true.rgb, seen.rgb))
                if lpips is not None:
                    of_colour["lpips"].append(lpips(true.rgb, seen.rgb))
    means = {name: float(np.mean(numbers)) if numbers else None for name, numbers in of_colour.items()}
    return Rendered(error_m / both if both else None, both / true_pixels if true_pixels else None, **means)


def psnr_db(true: Colour, seen: Colour) -> float:
    """Return the peak signal-to-noise ratio of images (H, W, 3), over all channels; peak 255."""
    import cv2

    return min(float(cv2.PSNR(true, seen, 255.0)), HIGHEST_PSNR_DB)


def ssim(true: Colour, seen: Colour) -> float:
    """Return the structural similarity of images (H, W, 3), the mean over channels and pixels.

    Wang et al. 2004: a Gaussian window of 11 x 11 with sigma 1.5, K1 = 0.01, K2 = 0.03, a range of 255; at the border
    the image is mirrored (cv2.quality).
    """
    import cv2

    return float(np.mean(cv2.quality.QualitySSIM.create(true).compute(seen)[:3]))
