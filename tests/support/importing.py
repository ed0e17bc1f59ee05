# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender reads in a process of its own, read in the test's, which has Blender already: another takes seconds."""

import json
from types import SimpleNamespace

from noisy_world.blender import scene_inspection
from noisy_world.blender.importing import program
from noisy_world.sources import blend_inspection, imported_meshes
from noisy_world.sources.mesh_reading import forget_meshes


def import_here(monkeypatch, capfd):
    """Carry out the orders to import in this process; capfd: hears what it says."""

    def here(order):
        capfd.readouterr()
        status = program.main(json.dumps(order))
        return SimpleNamespace(returncode=status, stdout=capfd.readouterr().out, stderr="")

    monkeypatch.setattr(imported_meshes, "_asked", here)
    forget_meshes()


def look_here(monkeypatch):
    """Look at scenes of a .blend in this process, which then has that file open."""

    def here(_command, _path, *, order, **_limits):
        answer = scene_inspection._answer(json.loads(order))
        return SimpleNamespace(returncode=0, stdout=f"{blend_inspection.MARK}{json.dumps(answer)}\n", stderr="")

    monkeypatch.setattr(blend_inspection, "run_blender", here)
