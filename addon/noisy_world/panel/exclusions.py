# SPDX-License-Identifier: GPL-3.0-or-later
"""What of the open scene is excluded from the dataset, and what the panel begins with in a file.

Objects and effects of the open scene that are excluded from the dataset: all that the panel did not load.

The panel says it above Generate, and Generate asks; and a preview of a frame says whether it is the dataset's.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
from bpy.app.handlers import persistent

from ..nodes.chain_scene import own_compositing
from ..preset.names import safe_name
from . import loading, open_scene, source_views
from .fields import LISTENERS, Handlers
from .own_objects import own_object
from .properties import panel_of
from .sidebar import write

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import ObjectTypeItems


# Objects that a render shows, in the order in which they are named; of empties, those that show a collection.
RENDERED: "tuple[ObjectTypeItems, ...]" = (
    "MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME", "GREASEPENCIL", "EMPTY", "LIGHT",
)  # fmt: skip
PLAIN_WORLD = {"ShaderNodeBackground", "ShaderNodeOutputWorld"}  # the nodes of a world of one colour
NAMED = 3  # at most; this and the next are chosen so that the sentence stays short
LONGEST_NAME = 24
STALE_S = 1.0  # of what is drawn, at most: not every change is reported to handlers
SHARE = 20.0  # what is drawn is found again after this many times the time that it took


@dataclass(frozen=True)
class _Found:
    """What was found at a moment, and how long that took."""

    names: tuple[str, ...]
    shows_dataset: bool
    at_s: float
    took_s: float


_found: dict[int, _Found] = {}  # by scene
_changed: set[int] = set()  # scenes, since they were last looked through


# --- what is left out ---


def excluded(scene: bpy.types.Scene) -> tuple[str, ...]:
    """Return what a render of the scene shows or is made with, and the dataset is not: names, most telling first."""
    if _is_made_without_ours(scene):
        return ()
    ours = own_object(scene, "mesh")
    loaded = ours is not None and loading.is_from_panel(scene, ours)
    shown = {item: None for item in _shown(scene) if not (loaded and item == ours)}
    names = [item.name for item in sorted(shown, key=lambda item: RENDERED.index(item.type))]
    if ours is not None and loaded and loading.is_changed(scene, ours):
        names.append(f"changes of {ours.name}")
    names += _cameras(scene)
    if own_compositing(scene) is not None and scene.render.use_compositing:
        names.append("the compositing")
    if is_pictured(scene.world):
        names.append("the world")
    return tuple(names)


def _is_made_without_ours(scene: bpy.types.Scene) -> bool:
    """Tell whether the dataset shows the scene itself, or a recording: then a preview's frames are the dataset's."""
    panel = panel_of(scene)
    return open_scene.is_shown(panel) or source_views.shows_footage(panel)


def _shown(scene: bpy.types.Scene) -> Iterator[bpy.types.Object]:
    """Yield the objects that a render of the scene shows, some more than once."""
    for layer in scene.view_layers:
        if layer.use:
            assert layer.layer_collection is not None
            yield from _shown_in(layer.layer_collection)
    if scene.background_set is not None:
        yield from _shown(scene.background_set)


def _shown_in(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Object]:
    collection = layer.collection
    assert collection is not None
    if collection.hide_render:
        return
    if not layer.exclude:
        for item in collection.objects:
            if item.type in RENDERED and not item.hide_render and (item.type != "EMPTY" or _is_instance(item)):
                yield item
    for child in layer.children:
        yield from _shown_in(child)


def _is_instance(item: bpy.types.Object) -> bool:
    return item.instance_type == "COLLECTION" and item.instance_collection is not None


def _cameras(scene: bpy.types.Scene) -> Iterator[str]:
    """Yield the cameras that a render looks through and the dataset does not, or what the dataset does not take."""
    ours = own_object(scene, "camera")
    cameras = [scene.camera, *(marker.camera for marker in scene.timeline_markers)]
    for camera in dict.fromkeys(item for item in cameras if item is not None):
        if camera != ours:
            yield f"the motion of {camera.name}" if _is_animated(camera) else camera.name
        elif loading.poses(scene) and not loading.is_from_panel(scene, camera):
            yield f"the path of {camera.name}"
        elif loading.is_changed(scene, camera):
            yield f"changes of {camera.name}"


def _is_animated(item: bpy.types.Object) -> bool:
    data = item.animation_data
    keyed = data is not None and (data.action is not None or len(data.drivers) > 0 or len(data.nla_tracks) > 0)
    return keyed or len(item.constraints) > 0 or (item.parent is not None and _is_animated(item.parent))


def is_pictured(item: bpy.types.World | None) -> bool:
    """Tell whether a world is more than one colour."""
    tree = None if item is None else item.node_tree
    return tree is not None and any(node.bl_idname not in PLAIN_WORLD for node in tree.nodes)


def shows_dataset(scene: bpy.types.Scene) -> bool:
    """Tell whether a render through the scene's camera shows what Generate renders: the panel's mesh, path and camera.

    Nothing else may be shown, and what was loaded may not have been changed since, nor the panel.
    """
    return not excluded(scene) and _shows_loaded(scene)


def _shows_loaded(scene: bpy.types.Scene) -> bool:
    if _is_made_without_ours(scene):
        return True
    mesh, camera = own_object(scene, "mesh"), own_object(scene, "camera")
    looks = camera is not None and scene.camera == camera and loading.poses(scene) > 0
    return looks and mesh is not None and mesh in _shown(scene)


# --- in words ---


def sentence(scene: bpy.types.Scene, names: tuple[str, ...] | None = None) -> str:
    """Return what the dataset leaves out and what it shows; "" where it leaves nothing out.

    names: what is left out; by default it is found.
    """
    names = excluded(scene) if names is None else names
    if not names:
        return ""
    panel = panel_of(scene)
    if panel.mesh_source == "ROOM":
        room = f"embedded room {panel.room_seed}" if panel.room_seed else "the embedded room"
        return f"Not in the dataset: {enumerated(names)}. The dataset shows {room}; choose another under Scene"
    mesh = Path(panel.of_mesh.mesh).name or "the mesh file under Scene"
    return f"Not in the dataset: {enumerated(names)}. The dataset shows {mesh}"


def enumerated(names: tuple[str, ...]) -> str:
    """Return names as text: all of a few, and of many the first ones and the number of the others."""
    short = [name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…" for name in names]
    if len(short) > NAMED:
        short = [*short[: NAMED - 1], f"{len(short) - NAMED + 1} more"]
    return " and ".join([", ".join(short[:-1]), short[-1]] if len(short) > 1 else short)


# --- the panel's part ---


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw what Generate would leave out."""
    if text := sentence(context.scene, _recent(context.scene).names):
        write(layout, context, text, "ERROR")


def draw_in_preview(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw that the pictures of frames are not the dataset's, where they are not."""
    scene = context.scene
    if scene.camera is not None and not _recent(scene).shows_dataset:
        write(layout, context, "Frames show your scene, not the dataset's", "INFO")


def _recent(scene: bpy.types.Scene) -> _Found:
    """Return what was found last; the scene is looked through again after a change, but not all the time."""
    now_s = time.perf_counter()
    known = _found.get(scene.session_uid)
    if known is not None:
        age_s = now_s - known.at_s
        is_stale = scene.session_uid in _changed or age_s > STALE_S
        if not is_stale or age_s < SHARE * known.took_s:
            return known
    _changed.discard(scene.session_uid)
    names = excluded(scene)
    is_datasets = not names and _shows_loaded(scene)
    done_s = time.perf_counter()
    found = _found[scene.session_uid] = _Found(names, is_datasets, done_s, done_s - now_s)
    return found


def _on_panel_change(scene: bpy.types.Scene, _: frozenset[str]) -> None:
    if isinstance(scene, bpy.types.Scene):
        _changed.add(scene.session_uid)


@persistent
def _on_change(scene: bpy.types.Scene, *_: object) -> None:
    _changed.add(scene.session_uid)


@persistent
def _forget_all(*_: object) -> None:
    _found.clear()
    _changed.clear()


_HANDLERS = Handlers(
    depsgraph_update_post=_on_change, undo_post=_forget_all, redo_post=_forget_all, load_post=_forget_all
)


def register() -> None:
    """Register the listener to the panel and the handlers that notice changes."""
    LISTENERS.append(_on_panel_change)
    _HANDLERS.add()


def unregister() -> None:
    """Unregister them."""
    _HANDLERS.remove()
    if _on_panel_change in LISTENERS:
        LISTENERS.remove(_on_panel_change)
    _forget_all()


# What the panel begins with in a file that it has not been used in: an artist's own scene is what it is about.


STARTUP = {"Cube", "Light"}  # what Blender's default scene renders


def begin(scene: bpy.types.Scene) -> None:
    """Let a scene's panel begin with This Scene, where it was never used and there is more than the default scene.

    The dataset's scene has the file's name, where a folder can have it.
    """
    if scene.library is None and scene.is_editable and not is_used(scene) and has_own_content(scene):
        panel_of(scene).mesh_source = "SCENE"
        name = Path(bpy.data.filepath).stem
        if name and not safe_name(name):
            panel_of(scene).scene.name = name


def is_used(scene: bpy.types.Scene) -> bool:
    """Tell whether a file holds any value of a scene's panel."""
    stored = scene.bl_system_properties_get()
    return stored is not None and "noisy_world" in stored and len(stored["noisy_world"].keys()) > 0


def has_own_content(scene: bpy.types.Scene) -> bool:
    """Tell whether a scene renders anything but what Blender's default scene does."""
    return any(item.type in RENDERED and item.name not in STARTUP for item in scene.objects)


@persistent
def _on_load(*_: object) -> None:
    for scene in bpy.data.scenes:
        begin(scene)


def _on_start() -> None:
    _on_load()


def register_first_look() -> None:
    """Register the handler of files that are opened, and look at the one that is open."""
    bpy.app.handlers.load_post.append(_on_load)
    # Later, as Blender's data cannot be accessed while add-ons are registered.
    bpy.app.timers.register(_on_start, first_interval=0.0)


def unregister_first_look() -> None:
    """Unregister both."""
    if bpy.app.timers.is_registered(_on_start):
        bpy.app.timers.unregister(_on_start)
    bpy.app.handlers.load_post.remove(_on_load)
