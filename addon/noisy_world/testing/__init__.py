# SPDX-License-Identifier: GPL-3.0-or-later
"""Contract tests: whether a perturbation, source, layout, trajectory format, channel, metric or system keeps its rules.

An author calls one from a test of his own; ours are held to the same.

    from noisy_world.testing import check_perturbation
    from my_noise.stereo_steps import PERTURBATION

    def test_it_keeps_the_contract():
        check_perturbation(PERTURBATION)

Each raises AssertionError with a sentence that names what was checked and which rule it breaks. None needs Blender.
"""

from .dataset_contracts import check_layout, check_source, check_trajectory_format
from .evaluation_contracts import check_map_metric, check_metric, check_system
from .frame_contracts import check_channel, check_perturbation

__all__ = [
    "check_channel",
    "check_layout",
    "check_map_metric",
    "check_metric",
    "check_perturbation",
    "check_source",
    "check_system",
    "check_trajectory_format",
]
