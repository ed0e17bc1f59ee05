# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender reads in a process of its own, read in the test's, which has Blender already: another takes seconds."""

import json
from types import SimpleNamespace

from noisy_world.render import import_program, scene_inspection
from noisy_world.sources import blender_process
from noisy_world.sources.rendered_mesh import forget_meshes


def import_here(monkeypatch, capfd):
    """Carry out the orders to import in this process; capfd: hears what it says."""

    def here(order):
        capfd.readouterr()
        status = import_program.main(json.dumps(order))
        return SimpleNamespace(returncode=status, stdout=capfd.readouterr().out, stderr="")

    monkeypatch.setattr(blender_process, "_asked", here)
    forget_meshes()


def look_here(monkeypatch):
    """Look at scenes of a .blend in this process, which then has that file open."""
    elsewhere = blender_process.run_blender

    def here(command, path, *, order="", **limits):
        if not order:
            return elsewhere(command, path, **limits)
        answer = scene_inspection._answer(json.loads(order))
        return SimpleNamespace(returncode=0, stdout=f"{blender_process.MARK}{json.dumps(answer)}\n", stderr="")

    monkeypatch.setattr(blender_process, "run_blender", here)
