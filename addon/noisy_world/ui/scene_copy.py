# SPDX-License-Identifier: GPL-3.0-or-later
"""The file that a dataset of the open scene is made from: the saved one or, where that is behind, a copy.

Blender writes other bytes each time it saves, and a dataset that goes on needs those that it was begun with. So a copy
is kept as long as nothing has changed that a render could show.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..blender.chain_scene import SHOWN, hide_chain, own_compositing, shown_chain
from ..blender.chain_values import LEFT_AT
from ..blender.scene_problems import uncomposed
from ..core.datasets.storage import storage_errors
from ..core.errors import StorageError
from ..core.utf8_names import utf8_name
from .described import tell
from .handlers import Handlers
from .output_place import output_folder
from .owned import OURS
from .properties import panel_of

SHOWN_BY = ("render", "view_settings", "display_settings", "cycles", "eevee", "display", "cycles_curves")
"""Parts of a scene whose values decide how it is rendered."""

VISIBLE_BY = (
    "hide_render", "visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission",
    "visible_volume_scatter", "visible_shadow", "is_shadow_catcher", "is_holdout", "instance_type", "pass_index",
)  # fmt: skip
OUR_PICTURES = ("Noisy World Color", "Noisy World Depth")

IGNORED = ("filepath", "rna_type", "bl_rna", "name", "is_movie_format", "compositor_device")


@dataclass(frozen=True)
class _Copy:
    """A copy of the open file, and what it was made from."""

    path: Path
    state: tuple[int, str]


_copies: dict[int, _Copy] = {}  # by scene
_changes = [0]  # how often something was changed that a render may show


def blend_file(scene: bpy.types.Scene) -> Path:
    """Return the file that a preset of the scene names, which `ensure` makes where it is not there."""
    known = _valid_copy(scene)
    if known is not None:
        return known
    if is_behind(scene):
        return beside_output(scene)
    return Path(bpy.data.filepath)


def ensure(scene: bpy.types.Scene, wanted: Path | None = None) -> str:
    """Make sure that the file a preset names holds the scene as it is; return what was done, "" where it does.

    wanted: where a copy is saved, by default beside the dataset's folder. Raises StorageError where it cannot be saved.
    """
    if _valid_copy(scene) is not None or not is_behind(scene):
        return ""
    path = wanted or beside_output(scene)
    _save_copy(path)
    _copies[scene.session_uid] = _Copy(path, _state(scene))
    why = "has no file yet" if not bpy.data.filepath else "has changed since it was saved"
    return f"the scene {why}, so a copy was saved to work from: {path}"


def known_files(scene: bpy.types.Scene) -> list[Path]:
    """Return the files that hold the open scene as it is or was: the open one, and a copy."""
    known = _copies.get(scene.session_uid)
    open_file = [Path(bpy.data.filepath)] if bpy.data.filepath else []
    return [*open_file, *([known.path] if known is not None else [])]


def keeps_compositing(scene: bpy.types.Scene) -> bool:
    """Tell whether frames of the scene itself are as its own compositing makes them: in the dataset and in previews."""
    chosen = panel_of(scene).compositing
    if chosen == "auto":  # as F12 shows it
        return scene.render.use_compositing and not uncomposed(own_compositing(scene))
    return chosen == "keep"


def is_behind(scene: bpy.types.Scene) -> bool:
    """Tell whether the saved file is another than the open one, or would be rendered otherwise."""
    kept_chain = keeps_compositing(scene) and shown_chain(scene) is not None
    return not bpy.data.filepath or bpy.data.is_dirty or kept_chain


def beside_output(scene: bpy.types.Scene) -> Path:
    """Return where a copy of the open file is saved: beside the dataset's folder."""
    folder = output_folder(panel_of(scene))
    return folder.with_name(f"{folder.name}_scene.blend")


def _valid_copy(scene: bpy.types.Scene) -> Path | None:
    known = _copies.get(scene.session_uid)
    if known is None or known.state != _state(scene) or not known.path.is_file():
        return None
    return known.path


def _save_copy(path: Path) -> None:
    """Save a copy of the open file, without the preview's chain."""
    previewed = [item for item in bpy.data.scenes if item.library is None and panel_of(item).preview]
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    before = _changes[0]
    try:
        for item in previewed:
            hide_chain(item)
        _write(path)
    finally:
        for item in previewed:
            tell("steps")(panel_of(item), bpy.context)
        _changes[0] = before


def save_as_it_is(path: Path) -> None:
    """Save a copy of the open file with all that it shows, such as the preview's chain.

    Raises StorageError where it cannot be saved.
    """
    before = _changes[0]
    try:
        _write(path)
    finally:
        _changes[0] = before


def _write(path: Path) -> None:
    filepaths = bpy.context.preferences.filepaths
    assert filepaths is not None
    former = filepaths.file_preview_type
    filepaths.file_preview_type = "NONE"  # or Blender would draw the scene for it
    try:
        bpy.ops.wm.save_as_mainfile(filepath=utf8_name(path), copy=True, check_existing=False, relative_remap=True)
    except RuntimeError as error:  # Blender reports in this way that it could not save
        raise StorageError(f"the scene cannot be saved: {str(error).strip()}", file=path) from error
    finally:
        filepaths.file_preview_type = former


# --- what has changed ---


def _state(scene: bpy.types.Scene) -> tuple[int, str]:
    """Return what is another after each change that a render of the scene may show.

    Blender reports changes of a scene's values, of visibility and of what is selected alike, so these are looked at.
    """
    values = {name: _plain(getattr(scene, name, None)) for name in SHOWN_BY}
    named = [getattr(item, "name", "") for item in (scene.world, scene.camera, scene.background_set)]
    frames = [scene.frame_start, scene.frame_end, scene.frame_step]
    markers = [[marker.frame, getattr(marker.camera, "name", "")] for marker in scene.timeline_markers]
    objects = [_of_object(item) for item in scene.objects if not _is_our_camera(item)]
    layers = [[layer.name, layer.use, layer.samples, *_of_layer(layer.layer_collection)] for layer in scene.view_layers]
    return _changes[0], json.dumps([scene.name, values, named, frames, markers, objects, layers], default=str)


def _plain(group: Any) -> dict[str, Any]:
    """Return the plain values of a group of properties."""
    if group is None:
        return {}
    plain = ("BOOLEAN", "INT", "FLOAT", "STRING", "ENUM")
    names = [item.identifier for item in group.bl_rna.properties if item.type in plain and not item.is_readonly]
    return {name: repr(getattr(group, name)) for name in names if name not in IGNORED}


def _of_object(item: bpy.types.Object) -> list[Any]:
    """Return what decides whether an object is rendered, and as what."""
    seen = [getattr(item, name) for name in VISIBLE_BY]
    materials = [getattr(slot.material, "name", "") for slot in item.material_slots]
    modifiers = [[modifier.name, modifier.show_render] for modifier in item.modifiers]
    used = [getattr(part, "name", "") for part in (item.data, item.parent, item.instance_collection)]
    return [item.name, seen, materials, modifiers, used, [[tie.name, tie.mute] for tie in item.constraints]]


def _of_layer(layer: bpy.types.LayerCollection | None) -> list[Any]:
    """Return what of a view layer's collections is rendered."""
    if layer is None or layer.collection is None:
        return []
    own = [layer.name, layer.exclude, layer.holdout, layer.indirect_only, layer.collection.hide_render]
    return [own, *(_of_layer(child) for child in layer.children)]


def _is_our_camera(item: bpy.types.ID) -> bool:
    """Tell whether this is the camera that we key, and no picture is taken through; or one of the tracked paths."""
    return OURS in item and item[OURS] != "mesh"


@persistent
def _on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Count a change of anything that a render may show, but for what `_state` looks at itself."""
    if all(window.scene != scene for window in bpy.context.window_manager.windows):
        return  # a copy of a scene that a still is rendered from
    if any(_counts(scene, update) for update in depsgraph.updates if update.id is not None):
        _changes[0] += 1


def _counts(scene: bpy.types.Scene, update: bpy.types.DepsgraphUpdate) -> bool:
    assert update.id is not None
    item = update.id.original
    if isinstance(item, (bpy.types.Scene, bpy.types.Collection)):
        return False
    if isinstance(item, bpy.types.Object):
        changed = update.is_updated_transform or update.is_updated_geometry or update.is_updated_shading
        return changed and not _is_our_camera(item)
    if isinstance(item, bpy.types.CompositorNodeTree):
        ours = SHOWN in item or LEFT_AT in item
        return keeps_compositing(scene) and not ours
    if isinstance(item, bpy.types.Image):
        return item.type not in ("RENDER_RESULT", "COMPOSITING") and item.name not in OUR_PICTURES
    if isinstance(item, bpy.types.Action):
        return item not in _our_actions(scene)
    return not (isinstance(item, bpy.types.Camera) and _is_ours_alone(scene, item))


def _our_actions(scene: bpy.types.Scene) -> list[bpy.types.Action]:
    """Return the actions of the preview's chains and of our camera."""
    owners = [*(tree for tree in bpy.data.node_groups if LEFT_AT in tree), *filter(_is_our_camera, scene.objects)]
    data = [owner.animation_data for owner in owners]
    return [item.action for item in data if item is not None and item.action is not None]


def _is_ours_alone(scene: bpy.types.Scene, lens: bpy.types.Camera) -> bool:
    return all(_is_our_camera(item) for item in scene.objects if item.data == lens)


@persistent
def _count(*_: object) -> None:
    _changes[0] += 1


@persistent
def _forget(*_: object) -> None:
    _copies.clear()


_HANDLERS = Handlers(depsgraph_update_post=_on_change, undo_post=_count, redo_post=_count, load_post=_forget)


def register() -> None:
    """Register the handlers that notice changes."""
    _HANDLERS.add()


def unregister() -> None:
    """Unregister them."""
    _HANDLERS.remove()
    _forget()
