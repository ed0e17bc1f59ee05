# SPDX-License-Identifier: GPL-3.0-or-later
"""What is seen through windows, by direction: s = right / ahead, t = up / ahead. (R, C, 3) display-encoded."""

import numpy as np

from .openings import Outlook
from .patterns import cloud, colour, hash01, mix, ramp
from .pictures import garden
from .surfaces import Array


def garden_from(share: float) -> Outlook:
    """The garden, with its hills and clouds elsewhere than in the living room's view."""

    def view(s: Array, t: Array) -> Array:
        return garden((s + share) * (-1.0 if share > 0.5 else 1.0), t)

    return view


def city(seed: int, sky_codes: tuple[str, str] = ("#e6edf2", "#8fb4d8")) -> Outlook:
    """Rows of houses with windows, the nearer ones darker and in front."""
    walls = [colour(c) for c in ("#b9a48f", "#a65f4a", "#8b8f96", "#c8b79c", "#6f7f8c", "#93755f")]
    panes = [colour(c) for c in ("#3a4855", "#566a7c", "#efd9a0", "#2c3640")]

    def view(s: Array, t: Array) -> Array:
        rgb = mix(colour(sky_codes[0]), colour(sky_codes[1]), ramp(t, 0.0, 1.1))
        white = ramp(cloud(s * 2.0 + seed, t * 5.0, seed, 4), 0.5, 0.7)
        rgb = mix(rgb, colour("#ffffff"), white * ramp(t, -0.05, 0.2))
        for k, (width, height, far) in enumerate(((0.16, 0.42, 0.45), (0.25, 0.24, 0.22), (0.42, 0.04, 0.0))):
            i = np.floor(s / width + 0.31 * k)
            top = height * (0.45 + 1.1 * hash01(i, i * 0 + k, seed + 1))
            x, y = s / width + 0.31 * k - i, (top - t) / width
            pick = hash01(i, i * 0 + k, seed + 2)
            wall = np.array(walls)[(pick * len(walls)).astype(np.int64)]
            bricks = 0.9 + 0.16 * hash01(np.floor(x * 34), np.floor(y * 40), seed + 3)
            floors = 3.0 + 3.0 * (pick * 13.0 % 1.0) // 1.0
            a, b = x * floors, y * floors * 0.85
            glass = (abs(a % 1.0 - 0.5) < 0.27) & (abs(b % 1.0 - 0.5) < 0.32) & (x > 0.04) & (x < 0.96)
            chosen = np.array(panes)[(hash01(np.floor(a) + 40 * i, np.floor(b), seed + 4) * 4).astype(np.int64)]
            bar = abs(a % 1.0 - 0.5) < 0.03
            house = np.where((glass & ~bar)[..., None], chosen, wall * bricks[..., None])
            house = np.where((y < 0.05)[..., None], wall * 0.6, house)
            rgb = np.where((t < top)[..., None], mix(house, colour(sky_codes[0]), np.full_like(t, far)), rgb)
        street = mix(colour("#6a6864"), colour("#8d8a84"), cloud(s * 9, t * 20, seed + 5, 3))
        rgb = np.where((t < -0.34)[..., None], street, rgb)
        tree = cloud(s * 5.0, t * 7.0, seed + 6, 3) + 0.5 * ramp(t, -0.05, -0.3) - 0.5 * ramp(t, -0.1, 0.12)
        leaf = mix(colour("#35592f"), colour("#8fae52"), cloud(s * 30, t * 30, seed + 7, 2))
        return np.where(((tree > 0.62) & (t > -0.4))[..., None], leaf, rgb)

    return view
