# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of the open scene as the generator renders them, here or of a copy in a process of its own.

Frames of a copy of the open file, rendered in a process of its own, so that the windows stay usable meanwhile.

Its folder holds the copy and the request; the frames come into it when all are there. Progress goes to standard output.
"""

import json
import os
import re
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import NoisyWorldError, memory_errors
from ..core.file_access import ScratchFolder, open_regular, read_text
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.geometry import Intrinsics, nearest_rotation, opencv_from_blender_c2w, pose
from ..core.lens import Distortion
from ..core.mirrored import Mirrored
from ..core.progress import JsonProgress
from ..core.trajectory import Trajectory
from ..nodes.chain_scene import hide_chain, shown_chain
from ..nodes.datablocks import override_scene
from ..preset.keys import EngineName
from ..scenes.sun_air import SunAir
from .engines import ENGINES, NAMES_IN_BLENDER, FrameRenderer, configure
from .own_scene import OwnSceneFile, OwnSceneSession
from .own_view import ShownColour, sampled_camera, show_frame
from .scene_inspection import open_file, samples_of, show_scene
from .source import RenderedFrame, RenderOptions, SceneLight, light_seen

# A frame of the open scene as the generator renders it from the .blend; the scene itself is not changed.


SCENE = "Noisy World still"


@dataclass(frozen=True)
class OwnStill:
    """What is rendered: a scene frame, whole or not, from a pose (4, 4) or, where that is None, by the scene's camera.

    follows: whether the path is that camera's own. clip_m: nearest and farthest, where they are not the camera's.
    engine, samples: where they are not the scene's own. depth_alpha: what is less opaque does not stop depth.
    lens: that distorts what the camera sees. sun_air: what softens sun lamps while it is rendered. mirrors: whether it
    tells what surfaces mirror.
    """

    frame: float
    c2w: NDArray[np.float64] | None
    follows: bool
    intrinsics: Intrinsics
    clip_m: tuple[float, float] | None
    engine: EngineName | None
    samples: int | None
    seed: int
    keep_compositor: bool
    depth_alpha: float
    lens: Distortion | None = None
    sun_air: SunAir | None = None
    mirrors: bool = False


def render_own_still(scene: bpy.types.Scene, still: OwnStill) -> RenderedFrame:
    """Render colour, display-encoded, and depth as the artist set the scene up.

    All is done in a copy of the scene, which shares its objects and is removed afterwards. Raises StorageError where no
    scratch file can be written.
    """
    with _nothing_left_behind():
        stand_in = scene.copy()
        stand_in.name = SCENE
        if still.keep_compositor and stand_in.compositing_node_group is not None:
            stand_in.compositing_node_group = stand_in.compositing_node_group.copy()
        found = _rendered(stand_in, still)
    assert found.light is not None, "the scene is lit"
    return replace(found, light=replace(found.light, encode=partial(shown_by, scene.name, still.frame)))


def _rendered(scene: bpy.types.Scene, still: OwnStill) -> RenderedFrame:
    sampled = sampled_camera(scene, None, [still.frame])
    parameters = sampled.parameters[0]
    camera = scene.objects[parameters.camera]
    engine = still.engine or NAMES_IN_BLENDER[scene.render.engine]
    near_m, far_m = still.clip_m or (parameters.near_m, parameters.far_m)
    options = RenderOptions(
        near_m=near_m, far_m=far_m, engine=engine, seed=still.seed, through_glass=True,
        samples=still.samples or samples_of(scene)[engine],
    )  # fmt: skip
    file = OwnSceneFile(
        path=Path(),
        scene=scene.name,
        frames=(still.frame,),
        stamps_s=(0.0,),
        fps=0.0,
        cameras=(camera.name,),
        follows=still.follows,
        lens_given=still.clip_m is not None,
        sampled=still.samples is not None,
        keep_compositor=still.keep_compositor,
        depth_alpha=still.depth_alpha,
        sun_air=still.sun_air,
        mirrors=still.mirrors,
    )
    c2w = still.c2w
    if c2w is None:
        axes = sampled.matrices[0, :3, :3] / np.linalg.norm(sampled.matrices[0, :3, :3], axis=0)
        c2w = opencv_from_blender_c2w(pose(nearest_rotation(axes), sampled.matrices[0, :3, 3]))
    at_once = SensorPaths(rgb=Trajectory(c2w[None], np.zeros(1)))
    with OwnSceneSession(file, at_once, still.intrinsics, options, scene=scene, lens=still.lens) as session:
        scene.render.use_persistent_data = False
        return session.frame(FrameRequest(0, 0.0, c2w, c2w))


def shown_by(name: str, frame: float, rgba: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return light (H, W, 4) as a scene of the open file shows it at one of its frames, (H, W, 3)."""
    scratch = ScratchFolder(rgba.nbytes)
    try:
        with _nothing_left_behind():
            scene = bpy.data.scenes[name].copy()
            if scene.animation_data is not None:  # exposure, for instance, may be keyed
                show_frame(scene, frame)
            return ShownColour(scene, (rgba.shape[1], rgba.shape[0]), scratch.path).encode(rgba)
    finally:
        scratch.remove()


@contextmanager
def _nothing_left_behind() -> Iterator[None]:
    """Remove what is made inside, however it ends."""
    kinds = ("scenes", "objects", "cameras", "images", "node_groups", "actions")
    before = {kind: set(getattr(bpy.data, kind)) for kind in kinds}
    try:
        yield
    finally:
        for kind in kinds:
            made = [item for item in getattr(bpy.data, kind) if item not in before[kind]]
            for item in made:
                if getattr(item, "type", "") != "RENDER_RESULT":  # Blender's own
                    getattr(bpy.data, kind).remove(item)


# Single frames of the user's scene, rendered as the generator would; the scene itself is not changed.


def render_stills(
    scene: bpy.types.Scene, frames: Sequence[int], *, empty: bool = False, longest_px: int | None = None
) -> list[RenderedFrame]:
    """Render colour and depth of scene frames through the scene's camera, with Cycles and one sample.

    empty: whether nothing is seen where there is no surface, as in a mesh's dataset; by default the world is.
    longest_px: of the longer side, at most; by default as many as the scene has.

    Render options are changed only in a copy of the scene, which shares its objects and is removed afterwards. Raises
    StorageError where no scratch file can be written.
    """
    stand_in = scene.copy()
    stand_in.name = SCENE
    try:
        _configure(stand_in)
        if longest_px is not None:
            _shrink(stand_in.render, longest_px)
        if empty:
            stand_in.world = None
        size_px = stand_in.render.resolution_x, stand_in.render.resolution_y
        renderer = FrameRenderer(stand_in, size_px, rgb=True, depth=True, encoded_colours=False)
        try:
            return [_render(renderer, stand_in, frame) for frame in frames]
        finally:
            renderer.close()
    finally:
        bpy.data.scenes.remove(stand_in)


def _configure(scene: bpy.types.Scene) -> None:
    scene.compositing_node_group = None
    configure(scene, ENGINES["cycles"], seed=0, samples=1, threads=0)
    ENGINES["cycles"].set_samples(scene, 1)
    scene.render.use_persistent_data = False
    scene.render.use_multiview = False
    scene.render.resolution_percentage = 100
    scene.render.use_border = False
    for layer in list(scene.view_layers)[1:]:
        layer.use = False


def _shrink(render: bpy.types.RenderSettings, longest_px: int) -> None:
    scale = min(1.0, longest_px / max(render.resolution_x, render.resolution_y))
    render.resolution_x = max(1, round(render.resolution_x * scale))
    render.resolution_y = max(1, round(render.resolution_y * scale))


def _render(renderer: FrameRenderer, scene: bpy.types.Scene, frame: int) -> RenderedFrame:
    # Not by the operator's own argument, which would render the active scene's frame.
    with override_scene(scene):
        scene.frame_set(frame)
        return renderer.render()


COPY, REQUEST, FRAMES = "scene.blend", "request.json", "frames.npz"  # in the folder
STEPS = 100  # of a frame, that progress counts
NICENESS = 5  # chosen: the window's drawing comes first, and an idle machine renders as fast
SAMPLES = re.compile(r"Sample (\d+)/(\d+)")  # in Blender's words on a render


@dataclass(frozen=True)
class StillRequest:
    """What is rendered of a scene: frames of the mesh that it shows, or the scene as it is set up.

    scene: its name. stills: by the source frame's number; None for a frame of the mesh, through the scene's camera.
    empty: whether nothing is seen where there is no surface. meter_px: of the longer side at most, where only what a
    meter sees of each frame is asked for; None for whole frames.
    """

    scene: str
    stills: Mapping[int, OwnStill | None]
    empty: bool = False
    meter_px: int | None = None

    def content(self) -> dict[str, Any]:
        """Return it as JSON values."""
        stills = {str(index): None if item is None else _content_of(item) for index, item in self.stills.items()}
        return {"scene": self.scene, "stills": stills, "empty": self.empty, "meter_px": self.meter_px}

    @classmethod
    def of(cls, content: dict[str, Any]) -> "StillRequest":
        """Return the request of such values."""
        stills = {int(index): None if item is None else _still_of(item) for index, item in content["stills"].items()}
        return cls(content["scene"], stills, content["empty"], content["meter_px"])


def _content_of(still: OwnStill) -> dict[str, Any]:
    return asdict(still) | {"c2w": None if still.c2w is None else still.c2w.tolist()}


def _still_of(content: dict[str, Any]) -> OwnStill:
    c2w, clip_m, lens, air = (content[name] for name in ("c2w", "clip_m", "lens", "sun_air"))
    given = {
        "c2w": None if c2w is None else np.array(c2w, dtype=np.float64),
        "clip_m": None if clip_m is None else tuple(clip_m),
        "intrinsics": Intrinsics(**content["intrinsics"]),
        "lens": None if lens is None else Distortion(lens["model"], tuple(lens["coefficients"])),
        "sun_air": None if air is None else SunAir(**air),
    }
    return OwnStill(**(content | given))


MIRRORED_IMAGES = tuple(item.name for item in fields(Mirrored))


def write_request(request: StillRequest, folder: Path) -> None:
    """Write the request for `main` into a folder, which holds the copy of the file."""
    (folder / REQUEST).write_text(json.dumps(request.content()), encoding="utf-8")


def read_frames(folder: Path) -> dict[int, RenderedFrame]:
    """Return the frames that `main` has written into a folder, by the source frame's number.

    Light of the open file's scene is shown as that scene shows it.
    """
    request, images = _read_request(folder), _read_images(folder)
    return {index: _frame(request, index, still, images) for index, still in request.stills.items()}


def read_metered(folder: Path) -> dict[int, NDArray[np.float32]]:
    """Return what a meter sees, (h, w, 3), of each frame that `main` has rendered for one, by its number."""
    return {int(index): light for index, light in _read_images(folder).items()}


def _read_images(folder: Path) -> dict[str, NDArray[np.float32]]:
    with open_regular(folder / FRAMES) as file, np.load(file) as held:
        return {name: held[name] for name in held.files}


def _read_request(folder: Path) -> StillRequest:
    return StillRequest.of(json.loads(read_text(folder / REQUEST)))


def _images_of(index: int, frame: RenderedFrame) -> dict[str, NDArray[np.float32]]:
    """Return the arrays of a frame by their names in the file."""
    light = frame.light
    found = {
        "rgb": frame.rgb, "depth_m": frame.depth_m, "behind_glass_m": frame.behind_glass_m,
        "light": None if light is None else light.rgb, "alpha": None if light is None else light.alpha,
    }  # fmt: skip
    if light is not None and light.mirrored is not None:
        found |= {name: getattr(light.mirrored, name) for name in MIRRORED_IMAGES}
    return {f"{index}/{name}": image for name, image in found.items() if image is not None}


def _frame(
    request: StillRequest, index: int, still: OwnStill | None, images: Mapping[str, NDArray[np.float32]]
) -> RenderedFrame:
    """Return the frame that `_images_of` gave the arrays of."""
    light = None
    if still is not None and f"{index}/light" in images:
        encode = partial(shown_by, request.scene, still.frame)
        mirrored = [images[f"{index}/{name}"] for name in MIRRORED_IMAGES if f"{index}/{name}" in images]
        told = Mirrored(*mirrored) if mirrored else None
        light = SceneLight(images[f"{index}/light"], images[f"{index}/alpha"], encode, told)
    glass_m = images.get(f"{index}/behind_glass_m")
    return RenderedFrame(images[f"{index}/rgb"], images[f"{index}/depth_m"], light=light, behind_glass_m=glass_m)


def main(folder: str) -> None:
    """Render what a folder asks for, and write the frames there."""
    if hasattr(os, "nice"):  # which Windows has not
        os.nice(NICENESS)
    progress = JsonProgress(os.fdopen(os.dup(1), "w", buffering=1), lost=lambda: os._exit(1))
    try:
        with memory_errors():
            _still_process_render(Path(folder), progress)
    except NoisyWorldError as error:
        progress.tell({"error": error.message})
        raise SystemExit(1) from error
    except Exception:  # noqa: BLE001 - a bug, which keeps its traceback
        traceback.print_exc()
        os._exit(1)  # with the error as the last words: Blender would add the script
    progress.tell({"result": "rendered"})


def _still_process_render(folder: Path, progress: JsonProgress) -> None:
    request = _read_request(folder)
    open_file(str(folder / COPY))
    scene = bpy.data.scenes[request.scene]
    show_scene(scene)
    if shown_chain(scene) is not None:
        hide_chain(scene)
    counted = _Counted(progress, len(request.stills))
    hear: Any = counted.hear  # the stubs give such functions no text
    bpy.app.handlers.render_stats.append(hear)
    images: dict[str, Any] = {}
    for number, (index, still) in enumerate(request.stills.items(), 1):
        if request.meter_px is not None:
            images[str(index)] = _metered(scene, index, still, request)
        elif still is not None:
            images |= _images_of(index, render_own_still(scene, still))
        else:
            images |= _images_of(index, render_stills(scene, [index], empty=request.empty)[0])
        counted.reach(number, 0.0)
    with (folder / FRAMES).open("wb") as file:
        np.savez(file, **images)


def _metered(scene: bpy.types.Scene, index: int, still: OwnStill | None, request: StillRequest) -> NDArray[np.float32]:
    """Render a frame in as few pixels as a meter needs; return what it sees."""
    assert request.meter_px is not None, "it is for a meter"
    if still is None:
        return light_seen(render_stills(scene, [index], empty=request.empty, longest_px=request.meter_px)[0])
    small = replace(still, intrinsics=still.intrinsics.shrunk(request.meter_px))
    return light_seen(render_own_still(scene, small))


class _Counted:
    """How much of the frames is rendered, told in steps, by what Blender says of the samples."""

    def __init__(self, progress: JsonProgress, frames: int) -> None:
        self._progress = progress
        self._done = self._frame = 0
        progress.start("frame", STEPS * frames)

    def hear(self, text: Any, *_: object) -> None:
        """Take Blender's words on the render."""
        if isinstance(text, str) and (found := SAMPLES.search(text)) is not None:
            self.reach(self._frame, int(found[1]) / max(1, int(found[2])))

    def reach(self, frame: int, share: float) -> None:
        """Tell that as many frames are done, and a share of the next one; never less than before."""
        self._frame = frame
        done = int(STEPS * (frame + share))
        if done > self._done:
            self._progress.advance(done - self._done)
            self._done = done
