# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames from arithmetic in Blender's place, and a dataset of many settings made of them."""

import sys

import fake_session
import pytest
from runs import run
from many_settings import COUNT, SETTINGS
from worlds import write_world


@pytest.fixture
def no_blender(monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    fake_session.Session.rendered.clear()


@pytest.fixture
def world(tmp_path):
    return write_world(tmp_path / "world", frames=COUNT, size=(40, 32), settings=SETTINGS)


@pytest.fixture
def out(no_blender, world, tmp_path):
    run(world, tmp_path / "out")
    return tmp_path / "out"
