# SPDX-License-Identifier: GPL-3.0-or-later
"""Both ways of casting rays."""

import pytest

WAYS = {"packets": 0, "ray by ray": 10**18}


@pytest.fixture(params=WAYS)
def way_of_casting(request, monkeypatch):
    """Cast rays of any scene in packets, or ray by ray."""
    if request.param == "packets":
        pytest.importorskip("numba", reason="numba is not installed: pip install '.[embree]'")
    monkeypatch.setattr("noisy_world.render.ray_session.PAYS_FROM_RAYS", WAYS[request.param])
    return request.param
