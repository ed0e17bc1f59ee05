# SPDX-License-Identifier: GPL-3.0-or-later
"""The shadow of a baseline against a plain loop over pairs of pixels."""

import numpy as np
from cases import cases

from noisy_world.perturbations.shipped._depth_devices import shadowed


def looped(disparity_px):
    """Return what another pixel is in front of, by looking at every pair of a row, in float32 as it is defined."""
    half = np.float32(0.5)
    hidden = np.zeros(disparity_px.shape, bool)
    for row, values in enumerate(disparity_px):
        seen = np.arange(values.size, dtype=np.float32) - values
        cells = np.rint(seen)
        for here in np.flatnonzero(values > 0):
            right = np.arange(here + 1, values.size)
            if not (seen[here] > seen[right] - half).any():
                continue
            known = right[(right > here + 1) & (values[right] > 0) & (cells[right] >= 0)]  # inside the second view
            hidden[row, here] = cells[here] < 0 or (np.abs(cells[known] - cells[here]) <= 1).any()
    return hidden


@cases("kind", ["steps", "noise", "void", "slope", "near", "one column"])
def test_a_shadow_is_what_a_pair_of_pixels_says(kind):
    rng = np.random.default_rng(7)
    height, width = 67, 1 if kind == "one column" else 150
    disparity = rng.choice([3.0, 9.25, 17.5], (height // 9 + 1, width // 9 + 1)).repeat(9, 0).repeat(9, 1)
    disparity = disparity[:height, :width]
    if kind in {"noise", "void"}:
        disparity = disparity + rng.normal(0, 0.4, disparity.shape)
    if kind == "void":
        disparity[rng.random(disparity.shape) < 0.3] = 0
    if kind == "slope":
        disparity = np.abs(np.cumsum(rng.normal(0, 1.5, disparity.shape), axis=1))
    if kind == "near":
        disparity = disparity * 40  # much of it is outside the second view
    disparity = np.maximum(disparity, 0).astype(np.float32)
    found = shadowed(disparity)
    np.testing.assert_array_equal(found, looped(disparity))
    assert found.any() or kind == "one column"
    np.testing.assert_array_equal(shadowed(disparity * np.float32(0.5), 2.0), found)  # in pixels twice as large
