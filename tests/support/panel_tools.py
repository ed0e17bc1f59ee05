# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on registered, and a small mesh and path for its panel."""

from types import SimpleNamespace

import bpy
import numpy as np
import yaml

from noisy_world.perturbations.parsing import is_sensor
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.scenes.ply_writer import write_ply
from noisy_world.perturbations import registry


def settings():
    return bpy.context.scene.noisy_world


def own_classes(*kinds):
    """Return the add-on's own classes of Blender's kinds, such as Operator."""
    return [cls for kind in kinds for cls in kind.__subclasses__() if cls.__module__.startswith("noisy_world.")]


def groups_of(group):
    """Return a group of properties and all that are in it, but for what is in lists."""
    found = [group]
    for item in group.bl_rna.properties:
        if item.type == "POINTER" and item.identifier != "rna_type":
            found += groups_of(getattr(group, item.identifier))
    return found


class Drawn:
    """A layout that knows the names of the properties that are drawn in it, and that there are such."""

    def __init__(self):
        self.names = []

    def prop(self, group, name, **_):
        assert name in group.bl_rna.properties, (group, name)
        self.names.append(name)

    def operator(self, *_, **__):
        return SimpleNamespace()

    def panel(self, *_, **__):
        return self, self

    def __getattr__(self, _):
        return lambda *_, **__: self


def square(path, size_m=1.0):
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64) * size_m
    rgb = np.array([[0, 0, 0], [128, 0, 0], [0, 128, 0], [0, 0, 128]], dtype=np.float32) / 255
    write_ply(path, Mesh(corners, rgb, np.arange(4, dtype=np.int32), np.zeros(1, dtype=np.int32)))
    return str(path)


def straight(path, count=10):
    poses = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    poses[:, 0, 3] = np.arange(count) / 10
    path.write_text("\n".join(" ".join(f"{value:g}" for value in pose.ravel()) for pose in poses))
    return str(path), poses


def open_document(document, path):
    """Write a preset's document to a file, and open that in the panel."""
    from noisy_world.panel.document import open_preset

    path.write_text(yaml.safe_dump(document))
    open_preset(settings(), path)


def use_files(tmp_path, count=10):
    item = settings()
    item.mesh_source = item.trajectory_source = "FILE"
    item.of_mesh.mesh = square(tmp_path / "square.ply")
    item.scene.trajectory.file, poses = straight(tmp_path / "traj.txt", count)
    return poses


def leave_one_sensor(panel, name):
    """Take a sensor of depth off the list where another is about to be added: depth is measured once."""
    sensors = {item.name for item in registry().values() if is_sensor(item)}
    if name in sensors:
        for index in reversed([k for k, item in enumerate(panel.steps) if item.perturbation in sensors]):
            panel.steps.remove(index)
