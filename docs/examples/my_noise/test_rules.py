# SPDX-License-Identifier: GPL-3.0-or-later
"""Does the perturbation keep the rules? Run by pytest."""

from my_noise.stereo_steps import PERTURBATION

from noisy_world.testing import check_perturbation


def test_it_keeps_the_rules() -> None:
    """Check it at every severity, alone and in a run."""
    check_perturbation(PERTURBATION)
