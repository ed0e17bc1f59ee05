# SPDX-License-Identifier: GPL-3.0-or-later
"""What was done to each frame, as frames.csv of a sequence holds it."""

from types import SimpleNamespace

import numpy as np

from noisy_world.evaluate.study import severities


def test_severity_of_each_step_and_frame():
    steps = [
        {"rgb": [{"name": "frost", "severity": 5}, {"name": "fog", "severity": 0}]},
        {},
        {"rgb": [{"name": "frost", "severity": 1}], "depth": [{"name": "fog_depth", "parameters": {}}]},
    ]
    found = severities([SimpleNamespace(done=done) for done in steps])
    assert sorted(found) == ["severity_fog", "severity_frost"]
    np.testing.assert_array_equal(found["severity_frost"], [5, np.nan, 1])
    np.testing.assert_array_equal(found["severity_fog"], [0, np.nan, np.nan])
    assert severities([]) == {}
