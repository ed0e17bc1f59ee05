# SPDX-License-Identifier: GPL-3.0-or-later
"""mRR and mCE, against figures worked out by hand."""

import pytest
from refusals import refused

from noisy_world.evaluate.metrics import corruption_error, resilience_rate


def test_resilience_is_the_mean_over_perturbations():
    # Fog: (0.9 + 0.6 + 0.3) / (3 * 0.9) = 2/3. Frost: 0.45 / 0.9 = 1/2. Their mean: 7/12.
    rate = resilience_rate({"frost": [0.45], "fog": [0.9, 0.6, 0.3]}, clean=0.9)
    assert rate.value == pytest.approx(7 / 12)
    assert rate.by_perturbation == pytest.approx({"fog": 2 / 3, "frost": 1 / 2})
    assert list(rate.by_perturbation) == ["fog", "frost"]
    assert rate.excluded == ()


def test_corruption_error_is_relative_to_the_baseline():
    # Fog: (0.1 + 0.4) / (0.2 + 0.3) = 1. Frost: 0.9 / 0.3 = 3.
    rate = corruption_error({"fog": [0.1, 0.4], "frost": [0.9]}, {"fog": [0.2, 0.3], "frost": [0.3], "snow": [0.1]})
    assert rate.value == pytest.approx(2.0)
    assert rate.by_perturbation == pytest.approx({"fog": 1.0, "frost": 3.0})
    same = {"fog": [0.1, 0.4], "frost": [0.9]}
    assert corruption_error(same, same).value == pytest.approx(1.0)


@pytest.mark.parametrize("clean", [0.0, None])
def test_a_system_that_fails_on_clean_frames_has_no_resilience(clean):
    rate = resilience_rate({"fog": [0.5]}, clean)
    assert (rate.value, rate.by_perturbation, rate.excluded) == (None, {}, ("fog",))


def test_what_cannot_be_divided_is_left_out():
    rate = corruption_error({"fog": [0.5], "frost": [0.5], "snow": [0.2]}, {"fog": [0.0], "snow": [0.4]})
    assert (rate.value, rate.excluded) == (0.5, ("fog", "frost"))
    assert corruption_error({}, {}).value is None
    assert resilience_rate({"fog": []}, 0.9).excluded == ("fog",)


def test_other_runs_are_not_compared():
    refused(corruption_error, {"fog": [0.1, 0.2]}, {"fog": [0.1]}, names="fog", error=ValueError)
