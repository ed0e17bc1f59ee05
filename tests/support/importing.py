# SPDX-License-Identifier: GPL-3.0-or-later
"""Importing meshes in the test's own process, which has Blender already: another takes seconds for each file."""

import json
from types import SimpleNamespace

from noisy_world.blender.importing import program
from noisy_world.sources import imported_meshes
from noisy_world.sources.mesh_reading import forget_meshes


def import_here(monkeypatch, capfd):
    """Carry out the orders to import in this process; capfd: hears what it says."""

    def here(order):
        capfd.readouterr()
        status = program.main(json.dumps(order))
        return SimpleNamespace(returncode=status, stdout=capfd.readouterr().out, stderr="")

    monkeypatch.setattr(imported_meshes, "_asked", here)
    forget_meshes()
