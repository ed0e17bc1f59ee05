# SPDX-License-Identifier: GPL-3.0-or-later
"""Contract tests: whether a perturbation, source, layout, trajectory format, channel, metric or system keeps its rules.

An author calls one from a test of his own; ours are held to the same.

    from noisy_world.testing import check_perturbation
    from my_noise.stereo_steps import PERTURBATION

    def test_it_keeps_the_contract():
        check_perturbation(PERTURBATION)

Each raises AssertionError with a sentence that names what was checked and which rule it breaks. None needs Blender.
"""

from .channels import check_channel
from .layouts import check_layout
from .map_metrics import check_map_metric
from .metrics import check_metric
from .perturbations import check_perturbation
from .sources import check_source
from .systems import check_system
from .trajectory_formats import check_trajectory_format

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
