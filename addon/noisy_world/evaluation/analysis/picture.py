# SPDX-License-Identifier: GPL-3.0-or-later
"""What single images are like: colour, its features, and depth; without knowing how they were made."""

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Grey: TypeAlias = NDArray[np.uint8]
Depth: TypeAlias = NDArray[np.float32]

FEATURES = 500
"""ORB features that are looked for at most in a frame; OpenCV's other parameters are its defaults."""

NEAR_BITS = 50
"""Two descriptors of 256 bits are one feature's where at most so many differ, as ORB-SLAM's stricter threshold."""

# The difference of two Laplacians (Immerkaer 1996): 0 where an image is affine along rows or along columns; of
# independent noise of standard deviation s its response has 6 s.
_NOISE_KERNEL = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
_SIGMA_OF_MEDIAN = 1.4826022185056018 / 6.0  # of the median of absolute values, for normal noise


class Features(NamedTuple):
    """ORB features of a frame: (N, 256) float32 descriptors, a bit as -1 or 1."""

    signs: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.signs)


def grey_of(rgb: NDArray[np.uint8] | NDArray[np.float32]) -> Grey:
    """(H, W, 3) RGB, bytes -> (H, W): luma of ITU-R BT.601, as every feature-based system takes it."""
    import cv2

    assert rgb.dtype == np.uint8, "datasets of light, as EXR files hold it, are not evaluated"
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def brightness_of(grey: Grey) -> tuple[float, float]:
    """Return the mean and the standard deviation (contrast) of an image, of 255."""
    import cv2

    mean, deviation = cv2.meanStdDev(grey)
    return float(mean[0][0]), float(deviation[0][0])


def laplacian_variance(grey: Grey) -> float:
    """Return the variance of the Laplacian (Pech-Pacheco et al. 2000): small in a blurred image, large in noise."""
    import cv2

    _, deviation = cv2.meanStdDev(cv2.Laplacian(grey, cv2.CV_32F))
    return float(deviation[0][0]) ** 2


def image_noise(grey: Grey) -> float:
    """Return the standard deviation of an image's noise, of 255, by the median response to a noise kernel."""
    import cv2

    response = cv2.filter2D(grey, cv2.CV_32F, _NOISE_KERNEL)[1:-1, 1:-1]
    return _median(np.abs(response)) * _SIGMA_OF_MEDIAN if response.size else 0.0


def features_of(grey: Grey) -> Features:
    """Return an image's ORB features (Rublee et al. 2011)."""
    import cv2

    _, descriptors = cv2.ORB.create(nfeatures=FEATURES).detectAndCompute(grey, None)
    if descriptors is None:
        return Features(np.zeros((0, 256), dtype=np.float32))
    return Features(np.unpackbits(np.asarray(descriptors, dtype=np.uint8), axis=1).astype(np.float32) * 2.0 - 1.0)


def tracked_features(before: Features, after: Features) -> int:
    """Return how many features of a frame are found again: pairs nearest to each other, at most NEAR_BITS apart.

    Ties go to the feature that was found first.
    """
    if not len(before) or not len(after):
        return 0
    alike = before.signs @ after.signs.T  # 256 - 2 differing bits, whole numbers, exact in float32
    there, back = alike.argmax(axis=1), alike.argmax(axis=0)
    own = np.arange(len(before))
    return int(np.sum((back[there] == own) & (alike[own, there] >= 256.0 - 2.0 * NEAR_BITS)))


def rmse(grey: Grey, clean: Grey) -> float:
    """Return the root mean square difference of two images, of 255."""
    difference = grey.astype(np.float32) - clean.astype(np.float32)
    return float(np.sqrt(np.mean(difference * difference, dtype=np.float64)))


def ssim(grey: Grey, clean: Grey) -> float:
    """Return the structural similarity of two images (Wang et al. 2004): 11 x 11, sigma 1.5, K 0.01 and 0.03."""
    import cv2

    return float(cv2.quality.QualitySSIM.create(clean).compute(grey)[0])


def depth_missing(depth_m: Depth) -> float:
    """Return the share of pixels without depth."""
    return 1.0 - np.count_nonzero(depth_m > 0.0) / depth_m.size


def depth_noise_m(depth_m: Depth) -> float:
    """Return the standard deviation of depth's noise, metres, by the median over the pixels; NaN without depth.

    The inverse depth of a plane is affine in the pixel, so the noise kernel answers 0 on any plane; its response, times
    the square of the depth, is that of the depth's own noise. Pixels next to one without depth are left out.
    """
    import cv2

    known = depth_m > 0.0
    inverse = np.divide(1.0, depth_m, out=np.zeros_like(depth_m), where=known)
    response = np.abs(cv2.filter2D(inverse, cv2.CV_32F, _NOISE_KERNEL)) * depth_m * depth_m
    whole = cv2.erode(known.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    inside = response[whole.view(bool)]
    return _median(inside) * _SIGMA_OF_MEDIAN if inside.size else float("nan")


def depth_error_m(depth_m: Depth, clean_m: Depth) -> float:
    """Return the mean absolute difference of two depths, metres, over pixels where both are; NaN where none is."""
    both = (depth_m > 0.0) & (clean_m > 0.0)
    return float(np.mean(np.abs(depth_m[both] - clean_m[both]), dtype=np.float64)) if both.any() else float("nan")


def median_depth_m(depth_m: Depth) -> float:
    """Return the median of the depth, metres, over pixels that have one; NaN without."""
    known = depth_m[depth_m > 0.0]
    return _median(known) if known.size else float("nan")


def _median(values: NDArray[np.float32]) -> float:
    """Return the lower median of values, at least one: several times as fast as numpy's."""
    middle = (values.size - 1) // 2
    return float(np.partition(values, middle, axis=None)[middle])
