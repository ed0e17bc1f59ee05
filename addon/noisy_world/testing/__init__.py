# SPDX-License-Identifier: GPL-3.0-or-later
"""Contract tests: whether a perturbation, a layout, a metric or a system keeps the rules that all of its kind keep.

An author calls one from a test of his own; ours are held to the same.

    from noisy_world.testing import check_perturbation
    from my_noise.stereo_steps import PERTURBATION

    def test_it_keeps_the_contract():
        check_perturbation(PERTURBATION)

Each raises AssertionError with a sentence that names what was checked and which rule it breaks. None needs Blender.
"""

from .layouts import check_layout
from .metrics import check_metric
from .perturbations import check_perturbation
from .systems import check_system

__all__ = ["check_layout", "check_metric", "check_perturbation", "check_system"]
