# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of poses with very long lines are read in a time that grows with their length, not with its square."""

import json
import time

import numpy as np
import pytest

from noisy_world.trajectories.formats import read_trajectory

LONG = 100_000
POSE = "0 0 0 0 0 0 0 1\n"
FRAME = json.dumps({"transform_matrix": np.eye(4).tolist()})[:-1]


@pytest.mark.parametrize(
    "text",
    [
        f"# x{' ' * LONG}y\n{POSE}",
        f"# x{'_' * LONG}y\n{POSE}",
        f"# {'a,' * LONG}\n{POSE}",
        f"{' ' * LONG}\n{POSE}",
        f'{{"frames": [{FRAME}, "file_path": "{"1" * LONG}x1"}}]}}',
        f'{{"frames": [{FRAME}, "file_path": "{"1x" * LONG}"}}]}}',
    ],
    ids=["blanks", "underscores", "cells", "a blank line", "digits", "digits and letters"],
)
def test_a_long_line_takes_no_time(text, tmp_path):
    path = tmp_path / "poses"
    path.write_text(text)
    began_s = time.process_time()
    assert len(read_trajectory(path)) == 1
    assert time.process_time() - began_s < 2.0  # by the square of the length it is minutes
