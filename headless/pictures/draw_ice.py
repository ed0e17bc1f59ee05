# SPDX-License-Identifier: GPL-3.0-or-later
"""Draw the pictures of ice that the frost perturbation puts over a frame, from seeded random numbers.

    python headless/pictures/draw_ice.py

Needles, ferns, rime and a wrinkled sheet: grey JPEG files in the add-on, where `frost` loads and tints them.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "addon"))

from noisy_world.core.streams import stream
from noisy_world.perturbations.shipped.frost import HEIGHT_PX, WIDTH_PX, picture_file

JPEG_QUALITY = 95  # chosen: the loss is far below what frost shows, and the four files stay small

Field: TypeAlias = NDArray[Any]  # (H, W) of floats; pyright takes three times as long where their type is named


def main() -> int:
    """Draw every picture and return the exit status."""
    for name in PICTURES:
        path = picture_file(name)
        path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(path), draw(name), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        print(f"wrote {path}: {path.stat().st_size / 2**20:.1f} MiB")
    return 0


def draw(name: str) -> NDArray[np.uint8]:
    """Return a grey picture, (HEIGHT_PX, WIDTH_PX) uint8, the same on every call."""
    paint, number, mean, std = PICTURES[name]
    grey = paint(stream("ice", number))
    grey = (grey - grey.mean()) * np.float32(std / float(grey.std())) + np.float32(mean)
    return np.rint(np.clip(grey, 0, 255)).astype(np.uint8)


def _clouds(generator: np.random.Generator, largest_px: float, smallest_px: float, decay: float = 0.5) -> Field:
    """Return smooth noise of standard deviation near 1: octaves of enlarged normal noise, each `decay` times weaker."""
    total = np.zeros((HEIGHT_PX, WIDTH_PX), dtype=np.float32)
    weight, scale_px, power = 1.0, largest_px, 0.0
    while scale_px >= smallest_px:
        cells = (int(WIDTH_PX / scale_px) + 4, int(HEIGHT_PX / scale_px) + 4)
        noise = generator.standard_normal((cells[1], cells[0]), dtype=np.float32)
        matrix = np.array([[1 / scale_px, 0, 1], [0, 1 / scale_px, 1]])
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        total += np.float32(weight) * cv2.warpAffine(noise, matrix, (WIDTH_PX, HEIGHT_PX), flags=flags)
        power += 0.55 * weight**2
        weight, scale_px = weight * decay, scale_px / 2
    return total / np.float32(np.sqrt(power))


def _lit(height: Field, angle_deg: float, softness_px: float = 0.0) -> Field:
    """Return a relief lit from the side: its slope along a direction, of standard deviation 1, glints clipped."""
    if softness_px:
        height = np.asarray(cv2.GaussianBlur(height, (0, 0), softness_px), height.dtype)
    angle = np.radians(angle_deg)
    slope = np.float32(np.cos(angle)) * cv2.Sobel(height, cv2.CV_32F, 1, 0)
    slope += np.float32(np.sin(angle)) * cv2.Sobel(height, cv2.CV_32F, 0, 1)
    slope /= slope.std()
    return np.clip(slope, -2.5, 4.0)


def _needles(generator: np.random.Generator) -> Field:
    """Draw a mat of long flat crystals in bundles, each with a bright and a shaded side, under a thin veil."""
    canvas = np.full((HEIGHT_PX, WIDTH_PX), 190, dtype=np.uint8)
    for size, bundles in ((2.2, 150), (1.5, 260), (1.0, 420), (0.6, 500)):
        for _ in range(bundles):
            root = generator.uniform((0, 0), (WIDTH_PX, HEIGHT_PX))
            heading = generator.uniform(0, 2 * np.pi)
            grey = generator.normal(192, 16)
            for _ in range(generator.integers(3, 9)):
                _needle(canvas, generator, (root, heading + generator.normal(0, 0.14)), size, grey)
    mat = cv2.GaussianBlur(canvas.astype(np.float32), (0, 0), 1.1)
    veil = np.clip(0.25 + 0.22 * _clouds(generator, 180, 20), 0, 0.8)
    mat += veil * (cv2.GaussianBlur(mat, (0, 0), 6) + 10 - mat)
    return mat + 9 * _clouds(generator, 500, 60) + 3 * _clouds(generator, 9, 2, 0.8)


def _needle(
    canvas: NDArray[np.uint8],
    generator: np.random.Generator,
    ray: tuple[NDArray[np.float64], float],
    size: float,
    grey: float,
) -> None:
    root, angle = ray
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    length = size * generator.gamma(4.0, 20.0)
    half_width = size * generator.uniform(1.0, 5.0)
    start = root + across * generator.normal(0, 14 * size) + along * generator.normal(0, 16 * size)
    end = start + along * length
    blunt = across * half_width * generator.uniform(0, 0.6)
    first, second = start + along * length * generator.uniform(0.05, 0.4), end - along * length * 0.1
    for side, shade in ((1, generator.normal(12, 9)), (-1, generator.normal(-13, 12))):
        corners = [start, first + side * half_width * across, second + side * blunt, end]
        _fill(canvas, np.stack(corners), grey + shade)


def _fill(canvas: NDArray[np.uint8], corners: NDArray[np.float64], grey: float) -> None:
    cv2.fillConvexPoly(canvas, np.rint(corners * 16).astype(np.int32), min(max(grey, 0.0), 255.0), cv2.LINE_AA, 4)


def _ferns(generator: np.random.Generator) -> Field:
    """Draw feathery dendrites: bent stems, branches at about 60 degrees, twigs on the branches."""
    dense = _clouds(generator, 400, 100)
    canvas = np.zeros((HEIGHT_PX, WIDTH_PX), dtype=np.uint8)
    for layer, (count, length_px) in enumerate(((500, 80.0), (600, 85.0), (420, 75.0))):
        for _ in range(count):
            root = generator.uniform((0, 0), (WIDTH_PX, HEIGHT_PX))
            thick = float(dense[int(root[1]), int(root[0])])
            if thick < generator.normal(-1.7, 0.9):
                continue
            segments = _fern(generator, root, length_px * generator.uniform(0.4, 1.6))
            shades = np.clip(generator.normal(95 + 35 * layer + 10 * thick, 30) + generator.normal(0, 25, 3), 30, 255)
            for number, grey in enumerate(shades):
                part = np.rint(segments[number::3] * 16).astype(np.int32)
                cv2.polylines(canvas, list(part), False, float(grey), 1, cv2.LINE_AA, 4)
        canvas = cv2.addWeighted(canvas, 0.9, cv2.GaussianBlur(canvas, (0, 0), 3), 0.12, 0.0)
    drawn = cv2.GaussianBlur(canvas, (0, 0), 0.6).astype(np.float32)
    drawn += 0.4 * cv2.GaussianBlur(drawn, (0, 0), 2.0)
    haze = cv2.GaussianBlur(drawn, (0, 0), 22) + 20 * _clouds(generator, 250, 30)
    return drawn + 0.3 * haze + 4 * dense + 4 * _clouds(generator, 5, 2, 0.8)


def _fern(generator: np.random.Generator, root: NDArray[np.float64], length_px: float) -> NDArray[np.float64]:
    """Return a fern's lines, (N, 2, 2): start and end, x and y."""
    heading, bend = generator.uniform(0, 2 * np.pi), generator.normal(0, 0.4)
    knots = max(int(length_px / 6.0), 4)
    share = np.sort(generator.uniform(0, 1, knots))
    angles = heading + bend * share
    stem = root + np.stack([np.cos(angles), np.sin(angles)], axis=-1) * (share * length_px)[:, None]
    lines = [np.stack([stem[:-1], stem[1:]], axis=1)]
    spread = generator.uniform(0.7, 1.05)
    reach = length_px * generator.uniform(0.15, 0.42) * np.sin(np.pi * (0.12 + 0.85 * share)) ** 0.8
    for side in (-1, 1):
        length = reach * generator.uniform(0.3, 1.2, knots)
        branch = _twigs(stem, angles + side * spread + generator.normal(0, 0.07, knots), length)
        lines.append(branch)
        for along in generator.uniform(0.15, 0.95, 5):
            start = branch[:, 0] + (branch[:, 1] - branch[:, 0]) * along
            turn = angles + generator.normal(0.1 * side, 0.1, knots)
            lines.append(_twigs(start, turn, length * generator.uniform(0.1, 0.4, knots) * (1.1 - along)))
    return generator.permutation(np.concatenate(lines))


def _twigs(start: NDArray[np.float64], angles: NDArray[np.float64], length: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([start, start + length[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)], axis=1)


def _rime(generator: np.random.Generator) -> Field:
    """Draw frozen drops, loosely in runs down the pane, and stars of blades where they have grown together."""
    cover = _clouds(generator, 350, 60)
    grains = _clouds(generator, 14, 2.5, 0.85)
    runs = generator.standard_normal((HEIGHT_PX, WIDTH_PX), dtype=np.float32)
    runs = cv2.GaussianBlur(runs, (0, 0), 5.0, sigmaY=13)
    runs /= runs.std()
    grown = 1 / (1 + np.exp(-2 * (0.8 * runs + 0.6 * cover + 0.9)))
    frozen = _lit(grains * grown, 250, 0.9) + 0.5 * np.maximum(grains * grown, 0)
    canvas = np.zeros((HEIGHT_PX, WIDTH_PX), dtype=np.uint8)
    for _ in range(330):
        centre = generator.uniform((0, 0), (WIDTH_PX, HEIGHT_PX))
        if cover[int(centre[1]), int(centre[0])] > generator.normal(0.5, 0.4):
            size = generator.uniform(0.5, 1.6)
            for angle in generator.uniform(0, 2 * np.pi, generator.integers(6, 20)):
                _blade(canvas, generator, centre, float(angle), size)
    shown = cv2.GaussianBlur((canvas > 0).astype(np.float32), (0, 0), 1.2)
    stars = (cv2.GaussianBlur(canvas, (0, 0), 0.9).astype(np.float32) - 128) / 36
    return frozen * (1 - 0.75 * shown) + stars * shown + 0.7 * cover + 0.3 * _clouds(generator, 60, 2, 0.8)


def _blade(
    canvas: NDArray[np.uint8], generator: np.random.Generator, root: NDArray[np.float64], angle: float, size: float
) -> None:
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    root = root + along * generator.uniform(0, 12 * size)
    length = size * generator.gamma(4.0, 7.0)
    tip, waist = root + along * length, root + along * length * generator.uniform(0.3, 0.7)
    half_width = length * generator.uniform(0.05, 0.16)
    shade = 128 + 35 * np.cos(angle - np.radians(250)) + generator.normal(0, 25)
    _fill(canvas, np.stack([root, waist + half_width * across, tip]), shade + 16)
    _fill(canvas, np.stack([root, waist - half_width * across, tip]), shade - 24)


def _sheet(generator: np.random.Generator) -> Field:
    """Draw a wrinkled sheet of ice: a bent relief of ridges, lit from the side."""
    columns, rows = np.meshgrid(np.arange(WIDTH_PX, dtype=np.float32), np.arange(HEIGHT_PX, dtype=np.float32))
    ridges = np.zeros((HEIGHT_PX, WIDTH_PX), dtype=np.float32)
    bent_x = columns + 30 * _clouds(generator, 160, 30)
    bent_y = rows + 30 * _clouds(generator, 160, 30)
    for largest_px, weight in ((90, 1.0), (45, 0.7), (22, 0.7), (10, 0.8)):
        folds = -np.abs(_clouds(generator, largest_px, largest_px / 4, 0.45)) * np.float32(weight * largest_px / 22)
        ridges += cv2.remap(folds, bent_x, bent_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    broad = _clouds(generator, 420, 100)
    patches = np.clip(1.0 + 0.4 * _clouds(generator, 200, 60), 0.5, 1.6)
    return _lit(ridges, 235, 0.5) * patches + 0.75 * broad + 0.35 * _clouds(generator, 3, 1.5, 0.8)


# For each picture: the function that draws it, the number of its stream, and the mean and standard deviation (0 to 255)
# that it is scaled to, which are those of the photographs that ImageNet-C picks from.
PICTURES: dict[str, tuple[Callable[[np.random.Generator], Field], int, float, float]] = {
    "sheet": (_sheet, 0, 131, 18),
    "needles": (_needles, 1, 207, 22),
    "rime": (_rime, 2, 152, 29),
    "ferns": (_ferns, 3, 123, 43),
}

if __name__ == "__main__":
    sys.exit(main())
