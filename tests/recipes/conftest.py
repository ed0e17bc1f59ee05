# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset of many settings with its recipe and its clean frames, made once."""

import pytest
from recipes_made import frames_from_arithmetic, make


@pytest.fixture
def no_blender():
    with frames_from_arithmetic():
        yield


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    with frames_from_arithmetic():
        return make(tmp_path_factory.mktemp("recipes"), output={"layout": "replica", "image": "jpg"})
