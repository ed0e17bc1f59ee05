# SPDX-License-Identifier: GPL-3.0-or-later
"""The range of bytes that a dry run gives, against what the files of shipped presets took."""

import pytest
from worlds import ROOT

from noisy_world.dataset.estimate import estimate
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan

# Megabytes of the images, links counted once, of these frames: made with engine embree and summed over the files.
MADE = {
    ("demo.yaml", 0, 3): 25.92,
    ("mixed.yaml", 0, 3): 29.38,
    ("study.yaml", 10, 14): 46.37,
    ("perturbations/gaussian_noise.yaml", 0, 6): 48.11,
    ("perturbations/contrast.yaml", 0, 3): 6.90,
}
SMALLER = {"study.yaml": ["camera={width: 320, height: 240, fx: 277, fy: 277, cx: 159.5, cy: 119.5}"]}
"""What was set anew when they were made."""


@pytest.mark.parametrize(("name", "start", "stop"), MADE)
def test_what_was_made_lies_in_the_range(name, start, stop):
    plan = make_plan(read_preset(ROOT / "presets" / name, SMALLER.get(name, [])), slice(start, stop))
    guess = estimate(plan)
    assert guess.least_bytes < MADE[name, start, stop] * 1e6 < guess.most_bytes
    assert guess.least_bytes <= guess.bytes_written <= guess.most_bytes
    assert guess.most_bytes < 6 * guess.least_bytes  # or it would say nothing
