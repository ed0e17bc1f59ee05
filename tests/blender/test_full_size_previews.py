# SPDX-License-Identifier: GPL-3.0-or-later
"""What groups do at the frame's own size in a preview: there and back, an image keeps its means and its positions."""

from dataclasses import replace

import numpy as np
import pytest
from cases import cases
from group_tools import IDENTIFIERS, picture, step_of

from noisy_world.nodes.compositor import Compositor
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped._sizes import full_size, with_full_sizes


def made(build, image, reference_width):
    """What a group of this build makes of a preview."""
    step = step_of("gaussian_blur", sigma_px=6.0)
    step = replace(step, perturbation=replace(registry()["gaussian_blur"], label="Sized", build=build))
    with Compositor((image.shape[1], image.shape[0]), {"x": [step]}, reference_width) as compositor:
        return compositor.evaluate(image, {"x": (0, IDENTIFIERS)})[0]["x"]


def there_and_back(canvas, _given, _served):
    full = full_size(canvas)
    return full.back(full.canvas.image)


@cases(("size", "reference_width"), [((24, 40), 80), ((25, 33), 66), ((1, 1), 2), ((1, 7), 14)])
def test_a_preview_of_half_the_size_comes_back_as_it_was(size, reference_width):
    image = 0.2 + 0.6 * picture(*size)  # where the slopes within pixels lead nowhere below 0
    assert np.abs(made(there_and_back, image, reference_width) - image).max() < 1e-4


@cases("reference_width", [40, 20, 1])
def test_an_image_of_the_frame_s_size_is_not_touched(reference_width):
    image = picture(24, 40)
    assert np.array_equal(
        made(there_and_back, image, reference_width), made(lambda canvas, *_: canvas.image, image, 40)
    )


@cases("reference_width", [50, 61, 97, 160])
def test_other_sizes_are_nearly_as_they_were(reference_width):
    image = picture(48, 40)
    assert np.abs(made(there_and_back, image, reference_width) - image).mean() < 0.02


def sizes(canvas, given, _served):
    full = full_size(canvas)
    sigma = with_full_sizes(full, given, "sigma_px")["sigma_px"]
    graph = canvas.graph
    shown = graph.vector(full.canvas.scale, full.canvas.width_px * 0.001, sigma * 0.01)
    return full.back(graph.math("MULTIPLY_ADD", full.canvas.image, (0.0, 0.0, 0.0), shown))


@cases(("reference_width", "expected"), [(120, (1.0, 0.12, 0.06)), (40, (1.0, 0.04, 0.06)), (60, (1.0, 0.06, 0.06))])
def test_sizes_are_those_of_the_frame(reference_width, expected):
    assert made(sizes, picture(24, 40), reference_width)[5, 7] == pytest.approx(expected, abs=1e-6)


def positions(canvas, _given, _served):
    full = full_size(canvas)
    graph = canvas.graph
    flipped = graph.math("MULTIPLY_ADD", full.pixel, (1.0, -1.0, 0.0), graph.vector(0.0, full.canvas.height_px - 1.0))
    return full.back(graph.math("ABSOLUTE", flipped - full.canvas.position_px))


@cases("reference_width", [40, 80])
def test_positions_count_the_frame_s_pixels_from_the_upper_left(reference_width):
    found = made(positions, picture(24, 40), reference_width)
    assert not found.any()
