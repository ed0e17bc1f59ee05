# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean frames for previews, and how the camera stands and what a meter saw at them."""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.camera_motion import CameraState, camera_state_of
from ..core.errors import InputError
from ..core.lens import Distortion
from ..core.schema import ConfigPath
from ..core.trajectory import Trajectory
from ..dataset.frame import Camera, CleanFrames, EarlierFrames, GreyFrames, PlannedFrame
from ..dataset.identity import render_seed
from ..dataset.sequence import PlannedSequence
from ..nodes.chain import decided_by
from ..nodes.chain_scene import DecidedAt
from ..perturbations.execution import split_motion
from ..perturbations.kinds import FrameContext
from ..preset.keys import EngineName
from ..render.own_stills import OwnStill, StillRequest, render_own_still, render_stills
from ..render.own_view import sampled_camera, shots_at
from ..render.source import RenderedFrame
from ..sources.renderers import lens_of
from . import exclusions, loading, open_scene, source_views
from .document import PANEL, engine_of, intrinsics_of, motion_of, preset_of, recorded
from .drawn_paths import clean_poses, clean_stamps_s, deviated_poses
from .fields import EMBREE
from .open_scene import keeps_compositing
from .properties import ITEMS, panel_of
from .tree import value_of


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
    return render_own_still(scene, own_still(scene, frame))


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
    return OwnStill(
        frame=at,
        c2w=None if keyed is None or (moved is None and follows) else keyed[index],
        follows=follows,
        intrinsics=intrinsics_of(panel),
        clip_m=(panel.camera.near_m, panel.camera.far_m) if panel.use_camera else None,
        engine=_engine(panel) if given else None,
        samples=panel.render.samples if sampled else None,
        seed=render_seed(value_of(panel, "seed")),
        keep_compositor=keeps_compositing(scene),
        depth_alpha=panel.of_blend.depth_alpha,
        lens=_lens(panel),
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


def keep(scene: bpy.types.Scene, lights: Mapping[int, NDArray[np.float32]]) -> None:
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
    if all(step.perturbation.decides is None for step in setting.rgb):
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
