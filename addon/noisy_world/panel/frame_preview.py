# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame's colour or depth as the generator writes it, and the clean frames that previews are made of."""

import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, TypeAlias

import bpy
import gpu
import numpy as np
from bpy.app.handlers import persistent
from numpy.typing import NDArray

from ..core.camera_motion import CameraState, camera_state_of
from ..core.depth_range import scale_that_holds
from ..core.errors import InputError, NoisyWorldError
from ..core.lens import Distortion
from ..core.schema import ConfigPath
from ..core.trajectory import Trajectory
from ..dataset.completion import colour_depth
from ..dataset.frame import Camera, CleanFrame, CleanFrames, EarlierFrames, GreyFrames, PlannedFrame
from ..dataset.identity import render_seed
from ..dataset.making import colour_of
from ..dataset.sequence import PlannedSequence, Shown, lay_out
from ..images.pixels import as_bytes, grey_bytes
from ..nodes.chain import decided_by
from ..nodes.chain_scene import DecidedAt
from ..nodes.datablocks import override, set_pixels, size_px
from ..perturbations.clipping import clipping
from ..perturbations.execution import split_motion
from ..perturbations.kinds import FrameContext
from ..perturbations.steps import Setting
from ..preset.keys import EngineName
from ..render.engines import NAMES_IN_BLENDER
from ..render.own_stills import OwnStill, StillRequest, render_own_still, render_stills
from ..render.own_view import sampled_camera, shots_at
from ..render.source import RenderedFrame, SceneLight
from ..sources.blend import reflections_problem
from ..sources.renderers import lens_of
from . import exclusions, loading, open_scene, runs, source_views
from .document import (
    PANEL,
    engine_of,
    format_of,
    identifiers_of,
    intrinsics_of,
    motion_of,
    preset_of,
    recorded,
    scene_name,
    setting_name,
    steps_of,
)
from .drawn_paths import clean_poses, clean_stamps_s, deviated_poses
from .fields import EMBREE, Handlers
from .open_scene import keeps_compositing
from .properties import ITEMS, panel_of
from .tree import value_of

# Clean frames for previews, and how the camera stands and what a meter saw at them.


def path_frames(scene: bpy.types.Scene) -> NDArray[Any]:
    """Return the scene frame of each pose of the clean path, whole or not."""
    if source_views.shows_footage(panel_of(scene)):
        return np.arange(len(recorded(panel_of(scene)).stamps_s))
    stamps_s = clean_stamps_s(scene)
    return open_scene.scene_frames(scene, len(stamps_s), stamps_s)


def rendered(scene: bpy.types.Scene, frame: int) -> RenderedFrame:
    """Render the frame of a pose: of a mesh it is the scene frame of this number; of a recording, read its frame."""
    panel = panel_of(scene)
    if source_views.shows_footage(panel):
        return source_views.still(recorded(panel), frame)
    if not open_scene.is_shown(panel):
        (still,) = render_stills(scene, [frame], empty=exclusions.shows_dataset(scene))
        return still
    still = own_still(scene, frame)
    with open_scene.as_it_was() if still.sun_air is not None or still.mirrors else nullcontext():
        return render_own_still(scene, still)


def request_of(scene: bpy.types.Scene, indices: Iterable[int]) -> StillRequest:
    """Return what another process is asked for, so that it renders what `rendered` does. Raises InputError."""
    chosen = sorted(indices)
    if open_scene.is_shown(panel_of(scene)):
        return StillRequest(scene.name, {index: own_still(scene, index) for index in chosen})
    return StillRequest(scene.name, dict.fromkeys(chosen), empty=exclusions.shows_dataset(scene))


def check_depth(scene: bpy.types.Scene) -> None:
    """Raise InputError where the dataset shows footage that has no depth."""
    panel = panel_of(scene)
    if source_views.shows_footage(panel) and not recorded(panel).source.capabilities.depth:
        name = {item: label for item, label, *_ in ITEMS}[panel.mesh_source]
        without = "take out what reads depth"
        remedy = without if panel.mesh_source == "RECORDING" else f"choose the folder of its depth, or {without}"
        raise InputError(f"Scene > {name}", "has no depth", remedy=remedy)


def beside(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return two pictures (H, W, 3) beside one another; the right one takes the left one's height."""
    import cv2

    if right.shape[0] != left.shape[0]:
        wide = max(1, round(right.shape[1] * left.shape[0] / right.shape[0]))
        right = np.asarray(cv2.resize(right, (wide, left.shape[0]), interpolation=cv2.INTER_NEAREST), np.uint8)
    return np.concatenate([left, right], axis=1)


def own_still(scene: bpy.types.Scene, index: int) -> OwnStill:
    """Return what is rendered for a pose of the path, where the dataset shows the scene itself.

    Raises InputError where the path has to be loaded first.
    """
    panel = panel_of(scene)
    given, sampled = panel.render.use_engine, panel.render.use_samples
    open_scene.check(scene)
    follows = open_scene.follows(panel)
    c2w = clean_poses(scene) if loading.has_current_path(scene) else None
    moved = None if c2w is None else deviated_poses(scene, c2w)
    if c2w is None and (not follows or has_moving_steps(scene)):
        raise InputError("Preview Frame", "the path is not loaded, or another by now", remedy="press Load Trajectory")
    at = float(path_frames(scene)[index])
    if (
        moved is not None
        and c2w is not None
        and open_scene.follows(panel)
        and open_scene.has_moved(scene, at, c2w[index])
    ):
        problem = "the scene's camera moves otherwise than when its path was loaded"
        raise InputError("Preview Frame", problem, remedy="press Load Trajectory")
    keyed = c2w if moved is None else moved
    engine = _engine(panel) if given else None
    if mirrors := open_scene.mirrors(panel):
        rendered_by = engine or NAMES_IN_BLENDER.get(scene.render.engine)
        if problem := reflections_problem(rendered_by, composited=keeps_compositing(scene)):
            raise InputError("Scene > Air in Reflections", problem, remedy="switch it off, or render so")
    return OwnStill(
        frame=at,
        c2w=None if keyed is None or (moved is None and follows) else keyed[index],
        follows=follows,
        intrinsics=intrinsics_of(panel),
        clip_m=(panel.camera.near_m, panel.camera.far_m) if panel.use_camera else None,
        engine=engine,
        samples=panel.render.samples if sampled else None,
        seed=render_seed(value_of(panel, "seed")),
        keep_compositor=keeps_compositing(scene),
        depth_alpha=panel.of_blend.depth_alpha,
        lens=_lens(panel),
        sun_air=open_scene.sun_air(panel),
        mirrors=mirrors,
    )


def _lens(panel: Any) -> Distortion | None:
    """Return the lens that distorts what the panel's camera sees. Raises InputError where it cannot."""
    if not panel.use_camera or not panel.camera.use_distortion:
        return None
    preset = preset_of(panel)
    assert preset.spec.camera is not None, "the panel gives it"
    assert preset.spec.camera.distortion is not None, "it distorts"
    place = preset.place("camera").at("distortion")
    return lens_of(preset.spec.camera.distortion, intrinsics_of(panel), place, cast=False)


def _engine(panel: Any) -> EngineName:
    """Return the engine that the panel gives. Raises InputError for one that shows no scene of a .blend."""
    engine = engine_of(panel)
    if engine == EMBREE:
        problem = "is Embree, which knows no lights or materials"
        raise InputError(PANEL, problem, where="render.engine", remedy="choose another engine")
    return engine


def has_moving_steps(scene: bpy.types.Scene) -> bool:
    """Tell whether a perturbation moves the poses of the path."""
    moving, _ = split_motion(motion_of(panel_of(scene)))
    return len(moving) > 0


# What a meter saw of a scene's frames, kept in the file, and what automatics decide by it frame by frame.


KEPT = "noisy_world_metered"  # of a scene: which frames of what were metered, and their light

Lights: TypeAlias = Mapping[float, NDArray[np.float32]]
"""By scene frame: what a meter saw of it, (h, w, 3) linear light."""


@dataclass(frozen=True)
class _Known:
    """What was decided last. made_from: what it follows from. by_frame: of each frame that was asked for."""

    made_from: list[Any]
    by_frame: dict[int, Mapping[str, FrameContext]]


_grey: set[int] = set()  # scenes whose preview follows mid-grey, as some of their frames were not metered
_known: dict[int, _Known] = {}  # by scene: a slider of another step decides nothing anew


def keep_light(scene: bpy.types.Scene, lights: Mapping[int, NDArray[np.float32]]) -> None:
    """Keep what a meter saw of source frames of the panel's path, in place of what was kept before."""
    frames = path_frames(scene)
    images = np.stack([lights[source] for source in sorted(lights)]).astype("<f4")
    scene[KEPT] = {
        "shows": panel_of(scene).mesh_source,
        "frames": [float(frames[source]) for source in sorted(lights)],
        "size": list(images.shape[1:3]),
        "light": images.tobytes(),
    }


def lights_of(scene: bpy.types.Scene, sequence: PlannedSequence) -> list[NDArray[np.float32]] | None:
    """Return what a meter saw of each source frame of the path; None where one that is shown was not metered."""
    kept: Any = scene.get(KEPT)
    if kept is None or kept["shows"] != panel_of(scene).mesh_source:
        return None
    images = np.frombuffer(kept["light"], "<f4").reshape(len(kept["frames"]), *kept["size"], 3)
    by_frame = dict(zip(kept["frames"], images, strict=True))
    found = [by_frame.get(float(frame)) for frame in path_frames(scene)]
    shown = [found[source] for source in set(sequence.source_frames)]
    lacks = any(light is None for light in shown)
    return None if lacks else [images[0] if light is None else light for light in found]


def earlier_of(scene: bpy.types.Scene, sequence: PlannedSequence) -> EarlierFrames | None:
    """Return what the frames of the panel's sequence have before them; None where no step asks, or it is not known."""
    lights = lights_of(scene, sequence) if sequence.setting.looks_back else None
    return None if lights is None else EarlierFrames(clean_stamps_s(scene), lambda source: lights[source])


def decided_at(scene: bpy.types.Scene, sequence: PlannedSequence) -> DecidedAt | None:
    """Return what automatics decide for a frame of the panel's sequence; None where it has none.

    Where frames were not metered, it is as if all had been mid-grey.
    """
    setting = sequence.setting
    if all(step.perturbation.automatic is None for step in setting.rgb):
        return None
    stamps_s, earlier = clean_stamps_s(scene), earlier_of(scene, sequence)
    (_grey.add if setting.looks_back and earlier is None else _grey.discard)(scene.session_uid)
    light: Any = None if earlier is None else scene[KEPT]["light"]
    made_from = [setting, sequence.identifiers, sequence.source_frames, stamps_s.tolist(), light]
    known = _known.get(scene.session_uid)
    if known is None or known.made_from != made_from:
        known = _known[scene.session_uid] = _Known(made_from, {})
    clean = CleanFrames(Camera(None, stamps_s, earlier=GreyFrames() if earlier is None else earlier))
    by_frame, last = known.by_frame, len(sequence.source_frames) - 1

    def decided(frame: int) -> Mapping[str, FrameContext]:
        frame = min(max(frame, 0), last)
        if frame not in by_frame:
            by_frame[frame] = decided_by(PlannedFrame(sequence, frame, clean).colour)
        return by_frame[frame]

    return decided


def follows_grey(scene: bpy.types.Scene) -> bool:
    """Tell whether what a scene's preview decided last is as if all frames before had been mid-grey."""
    return scene.session_uid in _grey


# How the camera of the panel's sequence stands and moves at a frame, for weather that is in the world.


def shown_path(scene: bpy.types.Scene, sources: Collection[int]) -> Trajectory | None:
    """Return the camera's path, on which at least the poses of some source frames are known; None where it has none.

    A path that is loaded is known wholly. That of the scene's own camera, where it is not loaded, is looked up at these
    frames alone. Raises NoisyWorldError where a recording cannot be read or a perturbation breaks its contract.
    """
    panel = panel_of(scene)
    if source_views.shows_footage(panel):
        return recorded(panel).path
    c2w = None if _waits(scene) else clean_poses(scene)
    if c2w is not None:
        moved = deviated_poses(scene, c2w)
        keyed = c2w if moved is None else moved
        stamps_s = clean_stamps_s(scene)
        shots = shots_at(scene, path_frames(scene)) if open_scene.follows(panel) else None
        return Trajectory(keyed, stamps_s, shots=shots) if len(stamps_s) == len(keyed) else None
    return _sampled(scene, sorted(set(sources))) if open_scene.follows(panel) and scene.camera is not None else None


def _sampled(scene: bpy.types.Scene, sources: list[int]) -> Trajectory:
    from ..sources.lit_scene import rigid_c2w

    stamps_s = clean_stamps_s(scene)
    found = sampled_camera(scene, None, path_frames(scene)[sources].tolist())
    c2w = np.tile(np.eye(4), (len(stamps_s), 1, 1))
    c2w[sources] = rigid_c2w(found.matrices, ConfigPath(open_scene.CAMERA_FIELD))
    posed = np.zeros(len(stamps_s), dtype=np.bool_)
    posed[sources] = True
    return Trajectory(c2w, stamps_s, posed=posed, shots=shots_at(scene, path_frames(scene)))


def camera_at(scene: bpy.types.Scene, sequence: PlannedSequence, frame: int) -> Camera:
    """Return what is known about the camera at a frame of the sequence. Raises NoisyWorldError as `shown_path` does."""
    earlier = earlier_of(scene, sequence)
    camera = Camera(intrinsics_of(panel_of(scene)), clean_stamps_s(scene), earlier=earlier)
    if not sequence.setting.uses_motion:
        return camera
    sources = [sequence.source_frames[k] for k in (0, max(frame - 1, 0), frame)]
    return replace(camera, path=shown_path(scene, sources))


def camera_states(scene: bpy.types.Scene, sequence: PlannedSequence) -> Callable[[int], CameraState] | None:
    """Return what gives the camera's state at a frame of the sequence, whose last one stays at later numbers.

    None where no perturbation asks for it, or where the path is not known wholly: the scene's own camera has to be
    loaded, as looking at all its frames would take seconds.
    """
    path = shown_path(scene, ()) if sequence.setting.uses_motion and not _waits(scene) else None
    if path is None:
        return None
    camera, last = Camera(None, path.stamps_s, path), len(sequence.source_frames) - 1
    return lambda frame: camera_state_of(camera.motion(sequence, min(max(frame, 0), last)))


def is_unknown(scene: bpy.types.Scene, sequence: PlannedSequence) -> bool:
    """Tell whether a perturbation asks how the camera moves, and its path has to be loaded for that."""
    return sequence.setting.uses_motion and _waits(scene)


def _waits(scene: bpy.types.Scene) -> bool:
    return open_scene.follows(panel_of(scene)) and not loading.has_current_path(scene)


Kind: TypeAlias = Literal["COLOUR", "DEPTH"]

PICTURES: dict[Kind, str] = {"COLOUR": "Noisy World Color", "DEPTH": "Noisy World Depth"}
STILLS_KEPT = 4  # rendered frames of a scene; chosen: desynchronisation sliders move between neighbours
CHANGES_PICTURE = (bpy.types.Camera, bpy.types.Light, bpy.types.Material, bpy.types.World)

_changes: dict[int, int] = {}  # by scene: how often its rendered frames were dropped
_outdated: dict[int, set[Kind]] = {}  # by scene: the pictures whose frames would be rendered otherwise by now
_stills: dict[int, OrderedDict[int, RenderedFrame]] = {}  # by scene and frame: clean, as rendered
_followed: dict[int, dict[Kind, int]] = {}  # by scene: the pictures that follow, and the frame each shows
_drawn: dict[int, "_Drawn"] = {}  # by scene: the colour that was perturbed last, for another split
_took_s: dict[int, float] = {}  # by scene: how long its pictures took when last drawn
_half_took_s: dict[int, float] = {}  # by scene: how long its colour took at half its size


@dataclass(frozen=True)
class _Drawn:
    """A frame's colour (H, W, 3) before and after, as its file holds it, and a caption. half: made at half its size."""

    index: int
    half: bool
    before: NDArray[np.uint8]
    after: NDArray[np.uint8]
    about: str


# --- what a frame looks like ---


def still_of(scene: bpy.types.Scene, frame: int) -> RenderedFrame:
    """Return a clean scene frame, which is rendered the first time it is asked for."""
    known = _stills.setdefault(scene.session_uid, OrderedDict())
    if frame not in known:
        keep(scene, frame, rendered(scene, frame))
    known.move_to_end(frame)
    return known[frame]


def keep(scene: bpy.types.Scene, frame: int, still: RenderedFrame) -> None:
    """Keep a clean scene frame that was rendered; the oldest of many is dropped."""
    known = _stills.setdefault(scene.session_uid, OrderedDict())
    known[frame] = still
    known.move_to_end(frame)
    while len(known) > STILLS_KEPT:
        known.popitem(last=False)


def forget(scene: bpy.types.Scene) -> None:
    """Drop a scene's rendered frames, so that they are rendered again when they are next asked for."""
    uid = scene.session_uid
    _changes[uid] = _changes.get(uid, 0) + 1
    _outdated[uid] = set(_followed.get(uid, ()))
    _stills.pop(uid, None)
    forget_drawn(scene)


def forget_drawn(scene: bpy.types.Scene) -> None:
    """Drop a scene's perturbed colour, so that it is perturbed again."""
    _drawn.pop(scene.session_uid, None)


def sequence_of(scene: bpy.types.Scene) -> tuple[PlannedSequence, int]:
    """Return the sequence that the panel describes, and which of its frames the current scene frame shows.

    Raises NoisyWorldError where a value of the panel is wrong.
    """
    panel = panel_of(scene)
    setting = Setting(setting_name(panel), steps_of(panel), panel.render.backend)
    frames = path_frames(scene)
    sequence = lay_out(setting, scene_name(panel), len(frames), identifiers_of(panel))
    now = scene.frame_current
    source = int(np.abs(frames - now).argmin()) if open_scene.is_shown(panel) else now
    return sequence, max(0, min(sequence.frame_at(source), len(sequence.source_frames) - 1))


def draw_colour(
    scene: bpy.types.Scene, index: int | None = None, *, half: bool = False
) -> tuple[NDArray[np.uint8], str]:
    """Return a frame's colour (H, W, 3) as the generator perturbs it, and a caption.

    index: of the frame in the panel's sequence, by default the current one. half: perturb it at half its size, and
    enlarge it, which is quicker and less fine. Left of the panel's split it is as rendered. Raises NoisyWorldError
    where a value of the panel is wrong, the frame is left out, or a scratch file cannot be written.
    """
    known = _drawn.get(scene.session_uid)
    if known is None or (known.index, known.half) != (index, half):
        known = _drawn[scene.session_uid] = _perturbed(scene, index, half=half)
    edge = round(panel_of(scene).preview_split * known.after.shape[1])
    if not edge:
        return known.after, known.about
    return np.concatenate([known.before[:, :edge], known.after[:, edge:]], axis=1), known.about


def _perturbed(scene: bpy.types.Scene, index: int | None, *, half: bool) -> _Drawn:
    sequence, now = sequence_of(scene)
    index = now if index is None else index
    if sequence.setting.needs_depth:
        check_depth(scene)
    source, stored = _shown(sequence, index).rgb_source, panel_of(scene).output.colour
    clean = _clean(scene, source, half=half)
    after = before = _as_stored(clean.rgb, stored)
    size = still_of(scene, source).rgb
    assert size is not None
    full = size.shape[:2]
    notes: list[dict[str, Any]] = []
    found = None
    if sequence.setting.rgb:
        height, width = before.shape[:2]
        only = replace(sequence, frames=range(index, index + 1))
        lit = clean.light is not None
        cameras, device = CleanFrames(camera_at(scene, sequence, index)), compositor_device(panel_of(scene))
        options = {"lit": lit, "device": device, "reference_width_px": full[1] if half else None}
        with colour_of([only], cameras, (width, height), **options) as colour:
            frame = colour.frames_of(clean)(only, index)
            made, notes = frame.changed("rgb"), frame.steps("rgb")
            after = before if made is None else _as_stored(made, stored)
            found = clipping(frame.colour.active, as_bytes(before), as_bytes(after))
    if half:
        before, after = (each.repeat(2, 0).repeat(2, 1)[: full[0], : full[1]] for each in (before, after))
    about = f"Frame {index}: {_listed(notes)}" if found is None else found.note(f"Frame {index}")
    return _Drawn(index, half, before, after, about)


def _halved(still: RenderedFrame) -> RenderedFrame:
    """Return a still at half its size: means of colour and light, every second pixel of depth."""
    import cv2

    assert still.rgb is not None
    size = tuple(-(-side // 2) for side in still.rgb.shape[1::-1])

    def mean(image: NDArray[np.float32]) -> NDArray[np.float32]:
        small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)
        return small.reshape(*small.shape[:2], -1)

    light = still.light
    return replace(
        still,
        rgb=mean(still.rgb),
        depth_m=None if still.depth_m is None else np.ascontiguousarray(still.depth_m[::2, ::2]),
        behind_glass_m=None if still.behind_glass_m is None else np.ascontiguousarray(still.behind_glass_m[::2, ::2]),
        light=None if light is None else _shrunk_light(light, mean),
    )


def _shrunk_light(light: SceneLight, mean: Callable[[NDArray[np.float32]], NDArray[np.float32]]) -> SceneLight:
    """Return light of half the size. mean: (H, W, ...) -> (h, w, channels)."""

    def alike(image: NDArray[np.float32]) -> NDArray[np.float32]:
        return mean(image).reshape(*mean(image).shape[:2], *image.shape[2:])

    mirrored = None if light.mirrored is None else light.mirrored.changed(alike)
    return replace(light, rgb=mean(light.rgb), alpha=mean(light.alpha), mirrored=mirrored)


def compositor_device(panel: Any) -> Literal["cpu", "gpu"]:
    """Return what the panel lets the compositor run on. Raises NoisyWorldError for a card that is not there."""
    if panel.render.compositor_device == "gpu" and is_software_gl():
        raise NoisyWorldError("Compositor Device is Graphics Card, but there is none here: choose Processor")
    return panel.render.compositor_device


def is_software_gl() -> bool:
    """Tell whether Blender draws without a graphics card."""
    return not bpy.app.background and gpu.platform.device_type_get() == "SOFTWARE"


def _as_stored(rgb: NDArray[Any], colour: str) -> NDArray[np.uint8]:
    """Return colour (H, W, 3) as its file holds it; of a grey file, three equal channels."""
    if colour == "grey":
        return np.repeat(grey_bytes(rgb)[..., None], 3, axis=2)
    return as_bytes(rgb)


def draw_depth(scene: bpy.types.Scene, index: int | None = None) -> tuple[NDArray[np.uint8], str]:
    """Return a frame's depth as the generator perturbs it, as a colour image (H, W, 3), and a caption.

    With desynchronisation (H, 2 W, 3): the frame's clean colour, and beside it the depth that is paired with it. index:
    of the frame in the panel's sequence, by default the current one. Raises NoisyWorldError where a value of the panel
    is wrong, the frame is left out, or a scratch file cannot be written.
    """
    sequence, now = sequence_of(scene)
    check_depth(scene)
    index = now if index is None else index
    shown = _shown(sequence, index)
    camera = Camera(intrinsics_of(panel_of(scene)), clean_stamps_s(scene))
    frame = PlannedFrame(sequence, index, CleanFrames(camera, camera, partial(_clean, scene)))
    depth_m, notes = frame.depth_m, frame.steps("depth")
    depth_m, lost = _held(scene, depth_m)
    seen_m = depth_m[depth_m > 0]
    near_m, far_m = (float(seen_m.min()), float(seen_m.max())) if seen_m.size else (0.0, 1.0)
    picture = colour_depth(depth_m, near_m, far_m)
    about = f"depth from {near_m:.2f} m (red) to {far_m:.2f} m (blue), void gray; {lost}{_listed(notes)}"
    if not sequence.paired:
        return picture, f"Frame {index}: {about}"
    colour = _as_stored(_clean(scene, shown.rgb_source).rgb, panel_of(scene).output.colour)
    pair = f"Color of frame {index}, depth of frame {shown.depth_frame}"
    return beside(colour, picture), f"{pair}: {about}"


def _held(scene: bpy.types.Scene, depth_m: NDArray[np.float32]) -> tuple[NDArray[np.float32], str]:
    """Return depth (H, W) without what its file cannot hold, and what to say of that; "" where it holds all."""
    output = panel_of(scene).output
    if output.depth_range == "scene" and not output.use_depth_scale_per_m:
        return depth_m, ""  # the scale will hold all of it
    format_ = format_of(panel_of(scene))
    lost = format_.out_of_range(depth_m)
    if lost is None:
        return depth_m, ""
    message = format_.depth_range.format_image_loss(lost, depth_m.size)
    if lost.farthest_m is not None:
        message += f" (a Depth Scale of {scale_that_holds(lost.farthest_m):g} holds that)"
    return format_.stored_depth_m(depth_m), f"{message}; "


def sources_of(scene: bpy.types.Scene, kind: Kind, index: int) -> set[int]:
    """Return the source frames that a picture is made of. Raises NoisyWorldError as `make_picture` does."""
    sequence, _ = sequence_of(scene)
    shown = _shown(sequence, index)
    if kind == "COLOUR":
        return {shown.rgb_source}
    return {shown.depth_source, *([shown.rgb_source] if sequence.paired else [])}


def _is_rendered(scene: bpy.types.Scene, sources: set[int]) -> bool:
    """Tell whether source frames are at hand; those of a recording are read, and always are."""
    return source_views.shows_footage(panel_of(scene)) or sources <= _stills.get(scene.session_uid, {}).keys()


def _shown(sequence: PlannedSequence, index: int) -> Shown:
    count = len(sequence.source_frames)
    if index >= count:  # the path was shortened meanwhile
        raise NoisyWorldError(f"frame {index} is not there any more: the path has {count} frames")
    if sequence.leaves_out(index):
        raise NoisyWorldError(f"frame {index} is left out: there is no depth to pair with it")
    return sequence.shown(index)


def _clean(scene: bpy.types.Scene, source: int, *, half: bool = False) -> CleanFrame:
    """Return a clean frame as the generator has it, not yet rounded, but clipped: the user's lights may exceed 1."""
    still = _halved(still_of(scene, source)) if half else still_of(scene, source)
    assert still.rgb is not None
    panel = panel_of(scene)
    shown = recorded(panel) if source_views.shows_footage(panel) else None
    return CleanFrame(
        source,
        replace(still, rgb=np.clip(still.rgb, 0.0, 1.0)),
        None if shown is None else shown.between,
        unmeasured_m=None if shown is None else shown.source.capabilities.unmeasured_m,
    )


def _listed(notes: list[dict[str, Any]]) -> str:
    return ", ".join(note["name"] for note in notes) or "clean"


# --- the pictures ---


def make_picture(
    scene: bpy.types.Scene, kind: Kind, index: int | None = None, *, half: bool = False
) -> tuple[bpy.types.Image, str]:
    """Draw a picture of a scene's frame into its image. Raises NoisyWorldError as `draw_colour` and `draw_depth` do.

    half: as `draw_colour` has it.
    """
    picture, about = draw_colour(scene, index, half=half) if kind == "COLOUR" else draw_depth(scene, index)
    height, width = picture.shape[:2]
    image = _image(kind)
    if image is None:
        image = bpy.data.images.new(PICTURES[kind], width, height, alpha=False)
    elif size_px(image) != (width, height):
        image.scale(width, height)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = picture[::-1] / np.float32(255)
    set_pixels(image, rgba)
    return image, about


def _image(kind: Kind) -> bpy.types.Image | None:
    return next((item for item in bpy.data.images if item.name == PICTURES[kind] and item.library is None), None)


def _editors() -> list[bpy.types.Area]:
    windows = bpy.context.window_manager.windows
    return [area for window in windows for area in window.screen.areas if area.type == "IMAGE_EDITOR"]


def _shown_in(area: bpy.types.Area) -> bpy.types.SpaceImageEditor:
    editor = area.spaces.active
    assert isinstance(editor, bpy.types.SpaceImageEditor)
    return editor


def open_picture(context: bpy.types.Context, image: bpy.types.Image) -> None:
    """Show an image in an open image editor; without one, half of the 3D view in use becomes one."""
    areas = _editors()
    shown = next((area for area in areas if _shown_in(area).image == image), areas[0] if areas else None)
    fresh = shown is None and context.area is not None and context.area.type == "VIEW_3D"
    if fresh:
        shown = _split_off(context)
    if shown is None:
        return
    _shown_in(shown).image = image
    shown.tag_redraw()
    if fresh:
        region = next(region for region in shown.regions if region.type == "WINDOW")
        with override(area=shown, region=region):
            bpy.ops.image.view_all(fit_view=True)


def _split_off(context: bpy.types.Context) -> bpy.types.Area | None:
    """Turn the half of a 3D view that is opposite its sidebar into an image editor."""
    view, known = context.area, {area.as_pointer() for area in context.screen.areas}
    if bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5) != {"FINISHED"}:
        return None
    halves = [view, *(area for area in context.screen.areas if area.as_pointer() not in known)]
    shown = min(halves, key=lambda area: area.x)
    shown.type = "IMAGE_EDITOR"
    return shown


def watching(scene: bpy.types.Scene) -> list[tuple[Kind, int, list[bpy.types.Area]]]:
    """Return the pictures of a scene that image editors show: kind, frame and editors of each."""
    editors, found = _editors(), []
    for kind, index in _followed.get(scene.session_uid, {}).items():
        image = _image(kind)
        areas = [area for area in editors if image is not None and _shown_in(area).image == image]
        if areas:
            found.append((kind, index, areas))
    return found


def follow(scene: bpy.types.Scene) -> None:
    """Redraw a scene's pictures that an image editor shows, as far as their frames are rendered already.

    Raises NoisyWorldError as `make_picture` does.
    """
    began_s, was_drawn = time.perf_counter(), scene.session_uid in _drawn
    for kind, index, areas in watching(scene):
        if not _is_rendered(scene, sources_of(scene, kind, index)):
            _outdated.setdefault(scene.session_uid, set()).add(kind)
            continue
        make_picture(scene, kind, index)
        _outdated.get(scene.session_uid, set()).discard(kind)
        for area in areas:
            area.tag_redraw()
    _half_took_s.pop(scene.session_uid, None)  # the next slider may be another perturbation's
    if not was_drawn:  # another split is quick, and says nothing of the time that a slider takes
        _took_s[scene.session_uid] = time.perf_counter() - began_s


def follow_coarsely(scene: bpy.types.Scene, most_s: float) -> None:
    """Redraw a scene's picture of colour at half its size, while a slider moves, where that takes at most so long.

    Only Blender's compositor knows to what size parameters in pixels refer. Raises NoisyWorldError as `draw_colour`.
    """
    uid = scene.session_uid
    if panel_of(scene).render.backend != "compositor" or _half_took_s.get(uid, 0.0) > most_s:
        return
    for kind, index, areas in watching(scene):
        if kind == "COLOUR" and _is_rendered(scene, sources_of(scene, kind, index)):
            began_s = time.perf_counter()
            make_picture(scene, kind, index, half=True)
            _half_took_s[uid] = time.perf_counter() - began_s
            for area in areas:
                area.tag_redraw()


def seconds_taken(scene: bpy.types.Scene) -> float:
    """Return how long a scene's pictures took when last drawn; 0 where none were."""
    return _took_s.get(scene.session_uid, 0.0)


def show_frame(context: bpy.types.Context, scene: bpy.types.Scene, kind: Kind, index: int) -> str:
    """Show a frame's picture in an image editor and follow it; say what it shows. Raises NoisyWorldError."""
    image, about = make_picture(scene, kind, index)
    _followed.setdefault(scene.session_uid, {})[kind] = index
    _outdated.get(scene.session_uid, set()).discard(kind)
    open_picture(context, image)
    return about if exclusions.shows_dataset(scene) else f"Your scene, not the dataset's: {about}"


def count_of_changes(scene: bpy.types.Scene) -> int:
    """Return how often a scene's rendered frames were dropped, which tells whether something changed since."""
    return _changes.get(scene.session_uid, 0)


def outdated(scene: bpy.types.Scene) -> set[Kind]:
    """Return a scene's pictures whose frames would be rendered otherwise by now."""
    return _outdated.get(scene.session_uid, set())


@persistent
def _on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Drop the rendered frames of a scene in which something was moved, edited or lit differently."""
    uid = scene.session_uid
    if open_scene.is_given_back() or (uid not in _stills and uid not in _followed and runs.active_still() is None):
        return
    if any(_makes_stale(item, scene) for item in depsgraph.updates):
        forget(scene)


def _makes_stale(update: bpy.types.DepsgraphUpdate, scene: bpy.types.Scene) -> bool:
    assert update.id is not None
    changed = update.id.original
    if isinstance(changed, bpy.types.Action):  # the sliders key actions of chains, which change no rendered frame
        animation = scene.camera.animation_data if scene.camera is not None else None
        return animation is not None and animation.action == changed
    # Not collections, which are reported as changed whenever a scene is copied, as for each still.
    moved = isinstance(changed, bpy.types.Object) and (update.is_updated_geometry or update.is_updated_transform)
    return moved or isinstance(changed, CHANGES_PICTURE)


@persistent
def _forget_all(*_: object) -> None:
    """Drop all rendered frames: another file was opened."""
    for kept in (_stills, _followed, _drawn, _took_s, _half_took_s, _changes, _outdated):
        kept.clear()


_HANDLERS = Handlers(depsgraph_update_post=_on_change, load_post=_forget_all)


def register() -> None:
    """Register the handlers for changes that make rendered frames out of date."""
    _HANDLERS.add()


def unregister() -> None:
    """Unregister them; the pictures stay in the file."""
    _HANDLERS.remove()
    _forget_all()
