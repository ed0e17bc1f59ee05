# SPDX-License-Identifier: GPL-3.0-or-later
from functools import partial

import pytest
from refusals import refusal

from noisy_world.trajectories.formats import read_trajectory


@pytest.fixture
def write(tmp_path):
    def write_file(content, name="poses.txt"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return file

    return write_file


@pytest.fixture
def refused(write):
    """The message about a file that must not be read, without the file's own name in front."""

    def message(content, **how):
        return refusal(partial(read_trajectory, **how), write(content))

    return message
