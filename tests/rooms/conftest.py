# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded rooms."""

import pytest


@pytest.fixture(scope="session")
def room(kept_rooms):
    """The embedded room, built here and now, as these tests are about that."""
    return kept_rooms.built(0)
