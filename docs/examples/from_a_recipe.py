# SPDX-License-Identifier: GPL-3.0-or-later
"""How bright the frames of some settings are: each is made on the spot, and none is written.

python from_a_recipe.py RECIPE [CLEAN_FRAMES]
"""

import sys

import noisy_world


def brightness(recipe: str, clean: str | None = None, settings: str = "*") -> dict[str, float]:
    """Return the mean of colour, 0 to 255, of each sequence."""
    sums: dict[str, float] = {}
    counts: dict[str, int] = {}
    with noisy_world.open(recipe, clean) as opened:
        for item in opened.frames(settings, frames=slice(0, 200), compressed=False):
            name = item["sequence"]
            sums[name] = sums.get(name, 0.0) + item["rgb"].mean()
            counts[name] = counts.get(name, 0) + 1
    return {name: sums[name] / counts[name] for name in sums}


if __name__ == "__main__":
    for name, value in brightness(*sys.argv[1:]).items():
        print(f"{name}: {value:.1f}")
