# SPDX-License-Identifier: GPL-3.0-or-later
"""The node group of frost on the lens beside the execution on arrays, given the numbers that the nodes draw."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from cases import cases
from group_tools import IDENTIFIERS, by_groups, by_nodes, levels_apart, picture, step_of

from noisy_world.nodes.compositor import Compositor
from noisy_world.perturbations import registry

PERTURBATION = registry()["lens_frost"]


class Drawn:
    """What the reference is given: the numbers that nodes drew."""

    def __init__(self, numbers, drift_frames=0):
        self.numbers, self.drift_frames, self.lit = numbers, drift_frames, False

    def pattern_stream(self):
        return self

    def random(self, count):
        assert count == 3
        return self.numbers


def drawn(index=0):
    """The three numbers that the group draws for a frame."""

    def shown(canvas, _given, _served):
        return canvas.graph.math("MULTIPLY_ADD", canvas.image, (0.0, 0.0, 0.0), canvas.random(0))

    step = step_of("lens_frost", severity=3)
    nodes = replace(PERTURBATION.nodes, build=shown, linear=False)
    step = replace(step, perturbation=replace(PERTURBATION, label="Numbers", nodes=nodes))
    with Compositor((4, 4), {"x": [step]}, 4) as compositor:
        made = compositor.evaluate(np.zeros((4, 4, 3), np.float32), {"x": (index, IDENTIFIERS)})[0]["x"]
    return made[0, 0].astype(np.float64)


@cases("size, severity", [((680, 690), 5), ((97, 131), 1), ((150, 90), 3), ((1, 1), 5), ((1, 40), 5)])
def test_as_on_arrays(size, severity):
    image, given = picture(*size), {"feathers": severity == 3, "halo": 0.5 * (severity != 1)}
    (found,) = by_nodes("lens_frost", image, severity=severity, **given)
    wanted = PERTURBATION.apply(image, PERTURBATION.at_severity(severity, **given), Drawn(drawn()))
    assert levels_apart(found, np.clip(wanted, 0, 1))[0] < 0.4
    assert size[0] == 1 or levels_apart(found, image)[1] > (2 if severity == 1 else 4)


def test_another_frame_another_part_and_another_light():
    image = picture(120, 200)
    made = by_nodes("lens_frost", image, range(3), severity=5, glint=4.0)
    for index, found in enumerate(made):
        wanted = PERTURBATION.apply(image, PERTURBATION.at_severity(5, glint=4.0), Drawn(drawn(index)))
        assert levels_apart(found, np.clip(wanted, 0, 1))[0] < 0.4
    assert levels_apart(made[0], made[1])[1] > 5


def test_it_grows_by_the_frame_and_fixed_stays():
    image = picture(96, 128)
    values = {"severity": 3, "coverage": 0.2, "growth_per_s": 0.4, "frame_rate_hz": 10.0}
    grown = by_nodes("lens_frost", image, (0, 6), temporal="drift", **values)
    fixed = by_nodes("lens_frost", image, (0, 6), temporal="fixed", **values)
    assert fixed[0].tobytes() == fixed[1].tobytes() == grown[0].tobytes()
    parameters = PERTURBATION.at_severity(3, **{name: values[name] for name in list(values)[1:]})
    wanted = PERTURBATION.apply(image, parameters, Drawn(drawn(0), drift_frames=6))
    assert levels_apart(grown[1], np.clip(wanted, 0, 1))[0] < 0.4


def test_a_preview_shows_the_same_ice_half_as_large():
    image = picture(240, 320)
    (full,) = by_nodes("lens_frost", image, severity=3)
    small = np.asarray(cv2.resize(image, (160, 120), interpolation=cv2.INTER_AREA))
    (half,) = by_nodes("lens_frost", small, severity=3, reference_width=320)
    assert levels_apart(half, cv2.resize(full, (160, 120), interpolation=cv2.INTER_AREA))[1] < 4


def test_what_is_brighter_than_white_comes_through(tmp_path):
    """In an artist's compositor, in linear light, in the clear middle: lamps of 4, 20 and 100; and the ice shines."""
    light = np.full((24, 36, 3), 0.2, np.float32)
    light[10:14, 12:15], light[10:14, 16:19], light[10:14, 20:23] = 4, 20, 100
    found = by_groups({"x": ("lens_frost", {"Coverage": 0.2})}, light, tmp_path)["x"]
    for column, value in ((13, 4), (17, 20), (21, 100)):
        assert found[12, column] == pytest.approx([value] * 3, rel=1e-3)
    assert found[0].max() > 0.2 * 1.6 * 1.3  # lamps light the ice: more than a surface of .2 lights at most
