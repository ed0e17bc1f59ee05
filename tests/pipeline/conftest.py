# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames from arithmetic in Blender's place, and a dataset of many settings made of them."""

import shutil
import sys
from pathlib import Path

import fake_session
import pytest
from runs import run
from many_settings import COUNT, SETTINGS
from recipes_made import frames_from_arithmetic
from worlds import write_world


@pytest.fixture
def no_blender(monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    fake_session.Session.rendered.clear()


@pytest.fixture
def world(tmp_path):
    return write_world(tmp_path / "world", frames=COUNT, size=(40, 32), settings=SETTINGS)


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("many_settings")
    with frames_from_arithmetic():
        run(write_world(folder / "world", frames=COUNT, size=(40, 32), settings=SETTINGS), folder / "out")
    return folder / "out"


@pytest.fixture
def out(no_blender, made_once, tmp_path):
    """The dataset of `world`, a copy of one that is made once: what is one file there is one file here."""
    copied = {}

    def copy(source, target):
        first = copied.setdefault(Path(source).stat().st_ino, target)
        return shutil.copy2(source, target) if first is target else Path(target).hardlink_to(first)

    return shutil.copytree(made_once, tmp_path / "out", copy_function=copy)
