# SPDX-License-Identifier: GPL-3.0-or-later
"""The open scene itself as what the dataset shows, and the file that a dataset of it is made from."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from numpy.typing import NDArray

from ..core.atomic_files import storage_errors
from ..core.errors import InputError, StorageError
from ..core.file_access import NOT_UTF8, RENAME, is_utf8, utf8_name, with_home
from ..core.geometry import Intrinsics
from ..core.schema import ConfigPath
from ..core.trajectory import Trajectory, rounded_path
from ..nodes.chain_scene import LEFT_AT, SHOWN, hide_chain, own_compositing, shown_chain
from ..preset.names import FrameRange
from ..render.own_view import bound_cameras, camera_parameters, sampled_camera
from ..render.scene_inspection import camera_problems, inspect_scene, scale_note, uncomposed
from ..scenes.sun_air import SunAir
from ..sources.blend import AirSpec
from .fields import Handlers, tell
from .own_objects import OURS, keys_state
from .properties import panel_of
from .tree import is_given, to_document, value_of

# Paths of the panel's files and of its dataset.


def output_folder(panel: Any) -> Path:
    """Return the dataset's folder. Raises InputError where the panel names none."""
    return folder_of(panel.output_folder, "Output")


def folder_of(named: str, field: str) -> Path:
    """Return a folder that a field names. Raises InputError where it names none, or one whose name is not UTF-8."""
    text = named.strip()
    if not text:
        raise InputError(field, "no folder is named", remedy="choose one")
    if text.startswith("//") and not bpy.data.filepath:
        raise InputError(field, f"{text} is beside this file, which has no place yet", remedy="save it")
    try:
        folder = Path(bpy.path.abspath(str(with_home(text)) if text.startswith("~") else text)).resolve()
    except LookupError as error:
        raise InputError(field, str(error)) from error
    if not is_utf8(folder):
        raise InputError(field, f"{folder} {NOT_UTF8}", remedy=RENAME)
    return folder


def absolute(path: str) -> str:
    """Return a path of the panel as an absolute one, with forward slashes; "" stays "".

    ~ and ~user are home folders; the name of a user who is not there stays, and is refused when the file is read.
    """
    if path.startswith("~"):
        try:
            path = str(with_home(path))
        except LookupError:
            return path
    return Path(bpy.path.abspath(path)).resolve().as_posix() if path else ""


# The file that a dataset of the open scene is made from: the saved one or, where that is behind, a copy.
#
# Blender writes other bytes each time it saves, and a dataset that goes on needs those that it was begun with. So a
# copy is kept as long as nothing has changed that a render could show.


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
_given_back: list[bool] = []  # not empty while what changes is given back


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


@contextmanager
def as_it_was() -> Iterator[None]:
    """Hear of no changes inside, where lamps are changed for a while and given back; those before are heard of."""
    layer = bpy.context.view_layer
    assert layer is not None
    layer.update()
    _given_back.append(True)
    try:
        yield
    finally:
        layer.update()
        _given_back.pop()


def is_given_back() -> bool:
    """Tell whether what changes now is given back."""
    return bool(_given_back)


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
    if is_given_back() or all(window.scene != scene for window in bpy.context.window_manager.windows):
        return  # the latter in a copy of a scene that a still is rendered from
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


CAMERA_FIELD = "Trajectory > Scene Camera"


def is_shown(panel: Any) -> bool:
    """Tell whether the dataset shows the scene itself."""
    return panel.mesh_source == "SCENE"


def follows(panel: Any) -> bool:
    """Tell whether the path is that of the scene's own camera."""
    return is_shown(panel) and panel.trajectory_source == "CAMERA"


def frame_range(scene: bpy.types.Scene) -> FrameRange:
    """Return the scene's frames that the dataset shows, where its own camera is the path."""
    step = scene.frame_step * panel_of(scene).scene.trajectory.every
    return FrameRange(scene.frame_start, max(scene.frame_start, scene.frame_end), step)


def scene_frames(scene: bpy.types.Scene, count: int, stamps_s: NDArray[np.float64] | None = None) -> NDArray[Any]:
    """Return the scene frame of each of the `count` poses of the path, whole or not.

    stamps_s: (N,) of the poses of a file, which may be fewer than `count`; then frames follow one another.
    """
    panel = panel_of(scene)
    if not is_shown(panel):
        return np.arange(count)
    if follows(panel):
        chosen = frame_range(scene)
        return chosen.first + chosen.step * np.arange(count)
    fps = scene.render.fps / scene.render.fps_base
    if stamps_s is None or len(stamps_s) < count:
        return scene.frame_start + np.arange(count)
    frames = scene.frame_start + (stamps_s[:count] - stamps_s[0]) * fps
    return np.where(np.abs(frames - np.round(frames)) < 1e-3, np.round(frames), frames)


def stamps_of(scene: bpy.types.Scene) -> NDArray[np.float64]:
    """Return the time stamps (N,) of the path of the scene's own camera, seconds."""
    frames = np.array(frame_range(scene).frames, dtype=np.float64)
    return (frames - frames[0]) * (scene.render.fps_base / scene.render.fps)


def own_camera(scene: bpy.types.Scene) -> bpy.types.Object:
    """Return the camera that the scene looks through at the current frame. Raises InputError where there is none."""
    camera = scene.camera
    if camera is None or camera.type != "CAMERA":
        raise InputError(CAMERA_FIELD, "the scene looks through no camera", remedy="add one, and make it the scene's")
    return camera


def intrinsics_of_scene(scene: bpy.types.Scene) -> Intrinsics:
    """Return the intrinsics of the scene's own camera. Raises InputError where it has none."""
    camera = own_camera(scene)
    parameters = camera_parameters(scene, camera)
    if parameters.kind != "PERSP":
        raise InputError(CAMERA_FIELD, f"{camera.name} is not perspective", remedy="change its type")
    return parameters.intrinsics


def sampled_path(scene: bpy.types.Scene) -> Trajectory:
    """Return the path of the scene's own camera, frame by frame.

    Raises InputError where it has none, or sees as no camera of a dataset does.
    """
    from ..sources.lit_scene import rigid_c2w

    own_camera(scene)
    sampled = sampled_camera(scene, None, frame_range(scene).frames)
    for item in camera_problems(sampled, lens_given=panel_of(scene).use_camera):
        raise InputError(CAMERA_FIELD, item.problem, remedy=item.remedy)
    c2w = rigid_c2w(sampled.matrices, ConfigPath(CAMERA_FIELD))
    note = scale_note(scene)
    path = Trajectory(c2w, stamps_of(scene), (f"This Scene: {note}",) if note else (), shots=sampled.shots)
    return rounded_path(path)


def check(scene: bpy.types.Scene) -> None:
    """Raise InputError where the scene, as it is open, can be no source: what is missing, scripted or not baked."""
    panel = panel_of(scene)
    given = panel.use_camera
    softened = sun_air(panel) is not None
    found = inspect_scene(scene, None, frame_range(scene), path=False, lens_given=given, softened=softened)
    needed = follows(panel) or not given
    for item in found.problems:
        if needed or item.key != "camera":
            raise InputError("This Scene", item.problem, remedy=item.remedy)


def entry(panel: Any, place: Any) -> dict[str, Any]:
    """Return what a preset's scene says of the open one. place: gives a file's path as the preset has it."""
    scene: bpy.types.Scene = panel.id_data
    said: dict[str, Any] = {"blend": place(str(blend_file(scene))), "scene": scene.name}
    if follows(panel):
        if scene.camera is not None and not bound_cameras(scene):
            said["camera"] = scene.camera.name
        chosen = frame_range(scene)
        said["frames"] = f"{chosen.first}:{chosen.last}" + (f":{chosen.step}" if chosen.step > 1 else "")
    elif scene.camera is not None:
        said["camera"] = scene.camera.name
    if keeps_compositing(scene):
        said["compositor"] = "keep"
    if panel.of_blend.use_depth_alpha:
        said["depth_alpha"] = value_of(panel.of_blend, "depth_alpha")
    if is_given(panel.of_blend, "air"):
        said["air"] = _air_said(panel)
    return said


def _air_said(panel: Any) -> dict[str, Any]:
    return to_document(panel.of_blend.air, AirSpec)


def sun_air(panel: Any) -> SunAir | None:
    """Return what softens the sun lamps of the open scene; None where nothing does."""
    return AirSpec(**_air_said(panel)).sun_air


def mirrors(panel: Any) -> bool:
    """Tell whether air lies behind surfaces of the open scene that mirror, too."""
    return AirSpec(**_air_said(panel)).reflections


def motion_state(scene: bpy.types.Scene) -> list[Any]:
    """Return what tells whether the scene's own camera still goes as it was sampled: what moves it, and its frames."""
    chosen, moved_by = frame_range(scene), []
    bound = bound_cameras(scene)
    for camera in dict.fromkeys(item for _, item in bound) if bound else (scene.camera,):
        item = camera
        while item is not None:
            still = item.animation_data is None and not item.constraints
            pose = [round(value, 6) for row in item.matrix_basis for value in row] if still else []
            moved_by.append([item.name, keys_state(item), pose])
            item = item.parent
    cuts = [[frame, item.name] for frame, item in bound]
    return [[chosen.first, chosen.last, chosen.step], moved_by, *([cuts] if cuts else [])]


def has_moved(scene: bpy.types.Scene, frame: float, c2w: NDArray[np.float64]) -> bool:
    """Tell whether the scene's own camera is elsewhere at a frame than at this pose (4, 4)."""
    from ..sources.lit_scene import rigid_c2w

    sampled = sampled_camera(scene, None, [frame])
    return not np.allclose(rigid_c2w(sampled.matrices, ConfigPath(CAMERA_FIELD))[0], c2w, atol=1e-5)
