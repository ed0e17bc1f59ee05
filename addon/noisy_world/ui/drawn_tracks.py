# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracked paths as curves in the scene: a collection of ours, which nothing renders and the next run replaces."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np
from mathutils import Color
from numpy.typing import NDArray

from ..blender.scene import get_origin
from .owned import OURS
from .tracked import FAR_M, NEAR_M, Part, TrackedPath, length

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import IconItems

COLLECTION = "Noisy World Tracking"
SENTENCE = "noisy_world_sentence"  # of a sequence's collection: what is said of it in the panel
PARTS: "dict[Part, tuple[str, IconItems, tuple[float, float, float]]]" = {
    "true": ("True path", "STRIP_COLOR_09", (0.85, 0.85, 0.85)),
    "lost": ("True path, lost", "COLORSET_16_VEC", (0.05, 0.05, 0.05)),
    # Of Okabe and Ito's palette for every colour vision.
    "near": (f"Error below {length(NEAR_M)}", "STRIP_COLOR_04", (0.0, 0.62, 0.45)),
    "off": (f"Error {length(NEAR_M)} to {length(FAR_M)}", "STRIP_COLOR_03", (0.94, 0.89, 0.26)),
    "far": (f"Error over {length(FAR_M)}", "STRIP_COLOR_01", (0.84, 0.37, 0.0)),
}
"""Name, icon and colour (sRGB) of each part."""
RADIUS_SHARE = 0.008  # of the estimate's tube, of the path's extent; this and the next two are chosen by eye
LEAST_RADIUS_M = 0.002
TRUE_SHARE = 0.6  # of the true path's tube, of the estimate's


def show(scene: bpy.types.Scene, paths: Sequence[TrackedPath]) -> None:
    """Put the paths into the scene, in place of those before."""
    remove(scene)
    ours = bpy.data.collections.new(COLLECTION)
    ours[OURS] = "tracking"
    ours.hide_render = True
    assert scene.collection is not None
    scene.collection.children.link(ours)
    for path in paths:
        own = bpy.data.collections.new(path.name)
        own[SENTENCE] = path.sentence
        own.hide_render = True
        ours.children.link(own)
        radius_m = _radius_m(path)
        for part in PARTS:
            if pieces := path.pieces.get(part):
                thick_m = radius_m * (TRUE_SHARE if part in ("true", "lost") else 1.0)
                own.objects.link(_curve(path.name, part, pieces, get_origin(scene), thick_m))


def remove(scene: bpy.types.Scene) -> None:
    """Remove the paths, and whatever was made for them; what a user has put beside them stays in the scene."""
    ours = collection_of(scene)
    if ours is None:
        return
    assert scene.collection is not None
    for item in list(ours.all_objects):
        if item.get(OURS) in PARTS:
            _remove_curve(item)
        elif all(collection in (ours, *ours.children) for collection in item.users_collection):
            scene.collection.objects.link(item)  # a user has put it there
    for child in (*ours.children, ours):
        bpy.data.collections.remove(child)


def _remove_curve(item: bpy.types.Object) -> None:
    data = item.data
    bpy.data.objects.remove(item)
    if not isinstance(data, bpy.types.Curve) or data.users:
        return
    materials = [material for material in data.materials if material is not None]
    bpy.data.curves.remove(data)
    for material in materials:
        if not material.users:
            bpy.data.materials.remove(material)


def collection_of(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """Return our collection of a scene."""
    assert scene.collection is not None
    return next((item for item in scene.collection.children_recursive if item.get(OURS) == "tracking"), None)


def shown(scene: bpy.types.Scene) -> list[bpy.types.Collection]:
    """Return the collections of the sequences whose paths a scene holds."""
    ours = collection_of(scene)
    return [] if ours is None else [item for item in ours.children if SENTENCE in item]


def parts_of(collections: Sequence[bpy.types.Collection]) -> list[Part]:
    """Return the parts that are there, for a legend."""
    there = {item.get(OURS) for collection in collections for item in collection.objects}
    return [part for part in PARTS if part in there]


def _radius_m(path: TrackedPath) -> float:
    whole = np.concatenate([piece for pieces in path.pieces.values() for piece in pieces])
    return max(LEAST_RADIUS_M, RADIUS_SHARE * float(np.ptp(whole, axis=0).max()))


def _curve(
    name: str, part: Part, pieces: list[NDArray[np.float64]], origin_m: NDArray[np.float64], radius_m: float
) -> bpy.types.Object:
    label, _, rgb = PARTS[part]
    curve = bpy.data.curves.new(f"{name}: {label}", "CURVE")
    assert isinstance(curve, bpy.types.Curve)
    curve.dimensions = "3D"
    curve.bevel_depth = radius_m
    curve.bevel_resolution = 1
    curve.use_fill_caps = True
    for piece in pieces:
        # A single frame between lost ones is drawn as a dot.
        ends = piece if len(piece) > 1 else np.stack([piece[0], piece[0] + (0.0, 0.0, radius_m)])
        spline = curve.splines.new("POLY")
        spline.points.add(len(ends) - 1)
        values = np.ones((len(ends), 4), np.float32)
        values[:, :3] = ends - origin_m
        spline.points.foreach_set("co", values.ravel())
    curve.materials.append(_material(label, rgb))
    item = bpy.data.objects.new(curve.name, curve)
    item[OURS] = part
    item.color = _linear(rgb)  # views that colour by attributes fall back to it
    item.show_in_front = True  # paths lead through rooms, which are viewed from outside
    item.hide_render = True
    item.visible_camera = item.visible_shadow = False  # for views in Rendered shading, which ask nothing else
    return item


def _material(label: str, rgb: tuple[float, float, float]) -> bpy.types.Material:
    name = f"Noisy World: {label}"
    found = next((item for item in bpy.data.materials if item.name == name and item.library is None), None)
    material = bpy.data.materials.new(name) if found is None else found
    material.diffuse_color = _linear(rgb)
    return material


def _linear(rgb: tuple[float, float, float]) -> Any:
    """Return a colour as Blender's properties take it, for which the stubs give no type."""
    red, green, blue = Color(rgb).from_srgb_to_scene_linear()
    return red, green, blue, 1.0
