# SPDX-License-Identifier: GPL-3.0-or-later
"""Classes of the objects of a scene that an artist made."""

from types import SimpleNamespace

import numpy as np

from noisy_world.channels.semantic import CHANNEL
from noisy_world.scenes.polygon_mesh import SceneObject

OBJECTS = [
    SceneObject(1, "Armchair", 0, "seat"),
    SceneObject(2, "Ceiling lamp", 0, "lamp"),
    SceneObject(3, "Cube", 0),
    SceneObject(5, "Stool", 0, "seat"),
]


def test_classes_of_a_scene_are_numbered_by_their_names():
    expected = [{"id": 1, "name": "lamp"}, {"id": 2, "name": "seat"}]
    assert CHANNEL.content_of(OBJECTS) == {"void": 0, "classes": expected}
    assert CHANNEL.content_of(OBJECTS[::-1]) == CHANNEL.content_of(OBJECTS)


def test_a_pixel_has_the_class_of_its_object_and_0_without_one():
    seen = SimpleNamespace(objects=np.array([[0, 1, 2], [3, 5, 65535]], np.uint16))
    found = CHANNEL.of_objects(OBJECTS)(seen)
    assert found.dtype == np.uint16
    assert found.tolist() == [[0, 2, 1], [0, 2, 0]]


def test_a_scene_without_classes_is_told_how_objects_get_them():
    assert CHANNEL.problem_of(lambda: OBJECTS) == ""
    assert "custom property `class`" in CHANNEL.problem_of(lambda: OBJECTS[2:3])


def test_a_mesh_says_which_file_is_not_beside_it(tmp_path):
    assert CHANNEL.problem("embedded:room") == ""
    assert CHANNEL.problem(str(tmp_path / "mesh.ply")) != ""
