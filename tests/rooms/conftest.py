# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded rooms."""

import pytest

from noisy_world.rooms import build_room


@pytest.fixture(scope="session")
def room():
    """The embedded room, built here and now, as these tests are about that."""
    return build_room()
