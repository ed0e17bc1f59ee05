# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands below Blender is tested as it has to work: without Blender."""

import sys
from pathlib import Path

import pytest

pytest.register_assert_rewrite("ply_files")
pytest.register_assert_rewrite("worlds")

WITHOUT_BLENDER = ("core", "perturbations", "pipeline", "rays", "sources")


@pytest.fixture(autouse=True)
def _no_bpy(request, monkeypatch):
    if request.path.relative_to(Path(__file__).parent).parts[0] in WITHOUT_BLENDER:
        monkeypatch.setitem(sys.modules, "bpy", None)  # importing it raises ImportError


@pytest.fixture(scope="session")
def room():
    """The embedded room, which takes seconds to make: one for all, as in the program."""
    from noisy_world.sources.mesh import load_mesh

    return load_mesh(None)
