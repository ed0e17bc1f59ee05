# SPDX-License-Identifier: GPL-3.0-or-later
"""What fog, frost, snow and spatter have in common: severities, patterns in time; and with blurs: sizes, threads."""

import tracemalloc

import numpy as np
from cases import cases

from weather import KEYS, MODULES, NAMES, TABLE, flat, frame, picture, run

BLURS = ("defocus_blur", "gaussian_blur", "glass_blur", "motion_blur")
PATTERNS = [(name, temporal) for name in NAMES for temporal in ("fresh", "drift")]
PATTERNS += [(name, "fresh") for name in BLURS]


@cases("name", NAMES)
@cases("severity", [1, 2, 3, 4, 5])
def test_the_severities_are_the_papers(name, severity):
    parameters = MODULES[name].PERTURBATION.at_severity(severity)
    assert tuple(getattr(parameters, key) for key in KEYS[name]) == TABLE[name][severity - 1]


@cases("name", ["fog", "frost", "spatter"])
def test_a_step_of_drift_is_smaller_than_a_fresh_pattern(name):
    black = flat((120, 160), 0.5)
    drift = [run(name, black, where=frame(k, "drift")) for k in (7, 8)]
    fresh = [[run(name, black, where=frame(k, seed=seed)) for k in (7, 8)] for seed in range(6)]
    assert np.abs(drift[0] - drift[1]).mean() < 0.8 * np.mean([np.abs(a - b).mean() for a, b in fresh])


@cases("name", NAMES)
@cases("temporal", ["fresh", "fixed", "drift"])
def test_writing_to_a_result_changes_no_later_one(name, temporal):
    rgb = picture((30, 40))
    for index in (0, 3):
        first = run(name, rgb, where=frame(index, temporal))
        kept = first.copy()
        first[...] = 7
        assert np.array_equal(run(name, rgb, where=frame(index, temporal)), kept)


@cases("name", [*NAMES, *BLURS])
def test_a_frame_larger_than_the_reference(name):
    result = run(name, picture((1081, 1921)) if name in BLURS else flat((1081, 1921), 0.5))
    assert result.shape == (1081, 1921, 3)
    assert np.isfinite(result).all()
    assert result.std() > 0.005


def test_kept_patterns_do_not_pile_up():
    def spatter_sequences(seeds):
        for seed in seeds:
            run("spatter", flat((200, 200)), where=frame(0, "fixed", seed=seed))

    tracemalloc.start()
    try:
        spatter_sequences(range(20))
        before, _ = tracemalloc.get_traced_memory()
        spatter_sequences(range(20, 60))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 2 * 200 * 200 * 4  # 40 more patterns were drawn
