# SPDX-License-Identifier: GPL-3.0-or-later
"""The mesh and the camera that Noisy World adds to a scene, in a collection of their own."""

import json
import zlib

import bpy
import numpy as np

from ..core.errors import InputError
from ..nodes.datablocks import camera_of, fcurves_of

# Marks data that Noisy World made in a scene, to tell it from the user's.


OURS = "noisy_world"
"""A custom property of our objects and collections: "mesh", "camera", "collection", "tracking", or a part of a path."""


MADE_AS = "noisy_world_made_as"  # the name that an object of ours was given, which tells it from a copy
COLLECTION = "Noisy World"


def own_object(scene: bpy.types.Scene, kind: str) -> bpy.types.Object | None:
    """Return our object of a scene: the "mesh" or the "camera". A copy that a user has made of it is the user's."""
    found = [item for item in scene.objects if item.get(OURS) == kind and item.library is None]
    return next((item for item in found if item.get(MADE_AS, item.name) == item.name), found[0] if found else None)


def mark(item: bpy.types.Object, kind: str) -> None:
    """Mark an object as ours."""
    item[OURS], item[MADE_AS] = kind, item.name


def put_into(scene: bpy.types.Scene, item: bpy.types.Object) -> None:
    """Put an object of ours into our collection of a scene, and into no other of that scene."""
    ours = _own_collection(scene)
    for collection in item.users_collection:
        if collection != ours and collection in _collections(scene):
            collection.objects.unlink(item)
    if item not in set(ours.objects):
        ours.objects.link(item)


def select(scene: bpy.types.Scene, item: bpy.types.Object) -> None:
    """Select an object alone and make it the active one, unless the user is in a mode of another object."""
    context = bpy.context
    in_use = context.view_layer if context.view_layer in set(scene.view_layers) else scene.view_layers[0]
    active = in_use.objects.active
    if item.name not in in_use.objects or (active is not None and active.mode != "OBJECT"):
        return
    for other in in_use.objects:
        if other.select_get(view_layer=in_use):
            other.select_set(False, view_layer=in_use)
    item.select_set(True, view_layer=in_use)
    in_use.objects.active = item


def take_out_mesh(scene: bpy.types.Scene) -> None:
    """Take our mesh out of a scene: remove it, unless another scene shows it too.

    Raises InputError while it is being edited.
    """
    item = own_object(scene, "mesh")
    if item is None:
        return
    if item.mode != "OBJECT":
        mode = item.mode.replace("_", " ").title()
        raise InputError("Load Scene", f"{item.name} is in {mode} Mode", remedy="leave that mode first")
    if is_shared(item):
        _split_collection(scene)
        for collection in set(item.users_collection) & _collections(scene):
            collection.objects.unlink(item)
    else:
        _remove_mesh(item)


def camera_alone(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """Return our camera of a scene; where a copy of the scene shows it too, this scene gets one of its own first."""
    shared = own_object(scene, "camera")
    if shared is None or not is_shared(shared):
        return shared
    _split_collection(scene)
    own = shared.copy()
    mark(own, "camera")
    own.data = camera_of(shared).copy()
    for collection in set(shared.users_collection) & _collections(scene):
        collection.objects.unlink(shared)
    put_into(scene, own)
    if scene.camera == shared:
        scene.camera = own
    return own


def is_shared(item: bpy.types.Object) -> bool:
    """Tell whether more than one scene shows an object."""
    return sum(item in set(scene.objects) for scene in bpy.data.scenes) > 1


def images_of(item: bpy.types.Object) -> list[bpy.types.Image]:
    """Return the images that the materials of a mesh of ours show."""
    materials = [] if not isinstance(item.data, bpy.types.Mesh) else item.data.materials
    trees = [material.node_tree for material in materials if material is not None]
    nodes = [node for tree in trees if tree is not None for node in tree.nodes]
    textures = [node for node in nodes if isinstance(node, bpy.types.ShaderNodeTexImage)]
    return [node.image for node in textures if node.image is not None]


def _remove_mesh(item: bpy.types.Object) -> None:
    data = item.data
    images = images_of(item)
    bpy.data.objects.remove(item)
    if not isinstance(data, bpy.types.Mesh) or data.users:
        return
    materials = [material for material in data.materials if material is not None]
    bpy.data.meshes.remove(data)
    for material in materials:
        if not material.users:
            bpy.data.materials.remove(material)
    for image in images:
        if not image.users:
            bpy.data.images.remove(image)


# --- how it is left ---


def keys_state(item: bpy.types.Object) -> str:
    """Return what decides where an object goes: its keys as a checksum, and what else could move it."""
    data, checksum = item.animation_data, 0
    if data is None:
        return ""
    for curve in fcurves_of(data):
        values = np.empty(2 * len(curve.keyframe_points), np.float32)
        curve.keyframe_points.foreach_get("co", values)
        name = f"{curve.data_path} {curve.array_index} {curve.mute} {len(curve.modifiers)}"
        checksum = zlib.crc32(values.tobytes(), zlib.crc32(name.encode(), checksum))
    return json.dumps([tied(item), len(data.drivers), len(data.nla_tracks), checksum])


def tied(item: bpy.types.Object) -> list[int]:
    """Return how many constraints an object has, and whether it has a parent."""
    return [len(item.constraints), int(item.parent is not None)]


# --- the collection ---


def _collections(scene: bpy.types.Scene) -> set[bpy.types.Collection]:
    """Return a scene's own collections: what another scene shows too is left out."""
    assert scene.collection is not None
    found = {scene.collection, *scene.collection.children_recursive}
    for other in bpy.data.scenes:
        if other != scene and other.collection is not None:
            found -= set(other.collection.children_recursive)
    return found


def _own_collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    _split_collection(scene)
    ours = next((item for item in _collections(scene) if item.get(OURS) == "collection"), None)
    if ours is None:
        assert scene.collection is not None
        ours = _new_collection()
        scene.collection.children.link(ours)
    return ours


def _new_collection() -> bpy.types.Collection:
    made = bpy.data.collections.new(COLLECTION)
    made[OURS] = "collection"
    return made


def _split_collection(scene: bpy.types.Scene) -> None:
    """Give a scene a collection of its own with the same content, where a copy of the scene shares ours."""
    assert scene.collection is not None
    own = _collections(scene)
    for shared in [item for item in scene.collection.children if item.get(OURS) == "collection" and item not in own]:
        made = _new_collection()
        for item in shared.objects:
            made.objects.link(item)
        for child in shared.children:
            made.children.link(child)
        scene.collection.children.unlink(shared)
        scene.collection.children.link(made)
