# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a source keeps its contract."""

import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, NoisyWorldError
from ..core.geometry import Intrinsics
from ..core.planning.scene import SceneEntry, SourceKind
from ..core.planning.source import OpenSource, OwnRendering, RenderOptions, Source, SourceFrame
from ..core.presets.preset import check_document
from ..core.regular_files import read_bytes
from ..core.schema import parse
from ..core.trajectories.frame_request import FrameRequest
from ..core.trajectories.sensor_paths import SensorPaths
from ..core.trajectories.trajectory import Trajectory
from .rules import CAMERA, require, require_name

MOST_FRAMES = 5
"""Of the path, its first ones are looked at."""
APART_M = 0.05
IMAGES = (".png", ".jpg", ".jpeg")
GONE = "no_such_file"


def check_source(kind: SourceKind[Any], scene: Mapping[str, Any], folder: Path) -> None:
    """Check a source. Raises AssertionError with the rule that it breaks.

    scene: an entry of a preset's scenes that is of it, and stands for one scene. folder: where the files lie that the
    entry names; they are copied.

    The entry is found and opened; stamps increase, one for each pose. Frames are asked for in order, backwards and each
    alone: the same bytes every time, colour and depth of the camera's size, depth planar, finite and 0 where there is
    none. What it says of itself is so: with `any_pose` it shows something else from elsewhere, `depth` says whether it
    has any, and between two frames it answers unless it says why not in `instants_only`; then it refuses. `hashes` are
    the same twice, and others where a file is that the entry names; a file that is not there is refused in a line that
    names its key. When it is closed no file of the folder is open, and it can be prepared again.
    """
    require(isinstance(kind, SourceKind), str(kind), f"is a {type(kind).__name__}, no source")
    require_name(kind.name)
    require(kind.label and kind.meaning, kind.name, "needs a label and a meaning")
    with tempfile.TemporaryDirectory() as copies:
        copy = Path(copies).resolve() / "files"
        shutil.copytree(folder, copy)
        try:
            source = _opened(kind, scene, copy)
            _check_frames(kind.name, source, copy)
        except NoisyWorldError as error:
            raise AssertionError(f"{kind.name}: {error}") from error
        _check_files(kind, scene, copy, source)


def _opened(kind: SourceKind[Any], scene: Mapping[str, Any], folder: Path) -> Source:
    preset = check_document({"scenes": [{}]}, folder / "preset.yaml")
    place = preset.place("scenes.0")
    entry = SceneEntry(preset, place, kind, parse(kind.keys, dict(scene), place))
    kind.check(entry.keys, place)
    found = list(kind.scenes(entry))
    require(len(found) == 1, kind.name, f"its entry stands for {len(found)} scenes; give one that stands for one")
    kind.check_found(found)
    return found[0].source()


# --- frames ---


def _check_frames(name: str, source: Source, folder: Path) -> None:
    require(source.location, name, "needs a location, for messages")
    path, stamps_s = source.trajectory(), source.stamps_s
    require(len(path) == len(stamps_s) > 0, name, f"has {len(path)} poses and {len(stamps_s)} stamps")
    require((np.diff(stamps_s) > 0).all(), name, "has stamps that do not increase")
    camera = source.camera(None) or source.camera(CAMERA)
    require(camera is not None, name, "returns no camera, though one is asked for")
    assert camera is not None
    source.optics(camera)
    count = min(MOST_FRAMES, len(path))
    whole = _frames(source, camera, path, range(count))
    for k, images in enumerate(whole):
        _check_images(name, source, camera, images, k)
    for order in (range(count - 1, -1, -1), *([k] for k in range(count))):
        again = dict(zip(order, _frames(source, camera, path, order), strict=True))
        for k, images in again.items():
            message = f"frame {k} is another when it is asked for {'alone' if len(again) == 1 else 'in another order'}"
            require(_equal(images, whole[k]), name, message)
    _check_capabilities(name, source, camera, path, whole)
    left = [file for file in _open_files() if Path(file).is_relative_to(folder)]
    require(not left, name, f"leaves {left[:1]} open when its context ends")


def _frames(source: Source, camera: Intrinsics, path: Trajectory, wanted: Sequence[int]) -> list[tuple[Any, Any]]:
    """Return colour and depth of frames as one session gives them."""
    with ExitStack() as closing:
        opened, paths = _session(source, camera, path, closing)
        return [_images(opened.frame(paths.request(k))) for k in wanted]


def _session(
    source: Source, camera: Intrinsics, path: Trajectory, closing: ExitStack
) -> tuple[OpenSource, SensorPaths]:
    prepared = closing.enter_context(source.prepare(camera, lambda _: None))
    own = source.capabilities.own or OwnRendering("embree", 1, 0.01, 1000.0)
    options = RenderOptions(own.near_m, own.far_m, own.samples, 0, engine=own.engine)
    paths = SensorPaths(path)
    return prepared.open(paths, options, lambda _: None), paths


def _images(frame: SourceFrame) -> tuple[NDArray[Any] | None, NDArray[Any] | None]:
    rgb, depth_m = frame.rgb, frame.depth_m
    return None if rgb is None else np.array(rgb), None if depth_m is None else np.array(depth_m)


def _equal(images: tuple[Any, Any], others: tuple[Any, Any]) -> bool:
    return all(np.array_equal(one, other) for one, other in zip(images, others, strict=True))


def _check_images(name: str, source: Source, camera: Intrinsics, images: tuple[Any, Any], k: int) -> None:
    rgb, depth_m = images
    size = (camera.height_px, camera.width_px)
    require(rgb is not None, name, "gives no colour")
    kinds = f"colour of frame {k} is {rgb.dtype} {rgb.shape}, but has to be (H, W, 3) of {size}, uint8 or float32"
    require(rgb.shape == (*size, 3) and rgb.dtype in (np.uint8, np.float32), name, kinds)
    if rgb.dtype == np.float32:
        require(
            np.isfinite(rgb).all() and rgb.min() >= 0 and rgb.max() <= 1, name, "gives colour that is not in [0, 1]"
        )
    has = source.capabilities.depth
    message = f"says depth={has}, but frame {k} has {'none' if depth_m is None else 'some'}"
    require((depth_m is not None) == has, name, message)
    if depth_m is None:
        return
    shape = f"depth of frame {k} is {depth_m.dtype} {depth_m.shape}, but has to be float32 {size}"
    require(depth_m.shape == size and depth_m.dtype == np.float32, name, shape)
    fine = np.isfinite(depth_m).all() and depth_m.min() >= 0
    require(fine, name, "gives depth that is negative or not finite; where there is none it is 0")


def _check_capabilities(
    name: str, source: Source, camera: Intrinsics, path: Trajectory, whole: list[tuple[Any, Any]]
) -> None:
    capabilities = source.capabilities
    if capabilities.any_pose:
        moved = np.array(path.c2w)
        moved[:, :3, 3] += APART_M
        (elsewhere,) = _frames(source, camera, Trajectory(moved, path.stamps_s), [0])
        message = "says any_pose, but shows the same from elsewhere; look from the poses of the request"
        require(not _equal(elsewhere, whole[0]), name, message)
    if len(path) < 2:
        return
    with ExitStack() as closing:
        opened, paths = _session(source, camera, path, closing)
        first, second = paths.request(0), paths.request(1)
        between = FrameRequest(None, (first.time_s + second.time_s) / 2, first.rgb_c2w, first.depth_c2w)
        try:
            _images(opened.frame(between))
        except NoisyWorldError as error:
            message = f"refuses what is between its frames ({error}); say why in instants_only"
            require(capabilities.instants_only, name, message)
        else:
            message = "says instants_only, but answers between its frames; raise InputError, or say nothing there"
            require(not capabilities.instants_only, name, message)


def _open_files() -> list[str]:
    """Return the files that this process has open, where the system tells."""
    links = Path("/proc/self/fd")
    found = []
    for link in links.iterdir() if links.is_dir() else ():
        try:
            found.append(str(link.readlink()))
        except OSError:  # of the listing itself
            continue
    return found


# --- files ---


def _check_files(kind: SourceKind[Any], scene: Mapping[str, Any], folder: Path, source: Source) -> None:
    name, before = kind.name, source.hashes()
    require(before == source.hashes(), name, "has other hashes the second time")
    json.dumps(before)
    for path in _named(scene):
        text, renamed = _at(scene, path), _with(scene, path, GONE)
        if not isinstance(text, str) or not (folder / text).exists():
            continue
        key = ".".join(path)
        try:
            _opened(kind, renamed, folder)
        except InputError as error:
            message = f"does not name the key {key} where its file is not there, but says: {error}"
            require(error.where.startswith(f"scenes.0.{path[0]}"), name, message)
        else:
            require(False, name, f"takes a {key} that is not there; raise InputError that names the key")
        other = shutil.copytree(folder, folder.with_name(f"other {key}"))
        if _change(other / text):
            require(_hashes(kind, scene, other) != before, name, f"has the same hashes for another {key}; hash it")


def _hashes(kind: SourceKind[Any], scene: Mapping[str, Any], folder: Path) -> dict[str, Any] | None:
    try:
        return _opened(kind, scene, folder).hashes()
    except InputError:  # it sees the change
        return None


def _change(path: Path) -> bool:
    """Change a file, or an image of a folder: its last becomes its first. Tells whether there is anything to change."""
    if path.is_file():
        with path.open("ab") as file:
            file.write(b"\n")
        return True
    first, *others = sorted(file for file in path.rglob("*") if file.suffix in IMAGES) or [path]
    if not others or read_bytes(first) == read_bytes(others[-1]) or first.suffix != others[-1].suffix:
        return False
    shutil.copyfile(first, others[-1])
    return True


def _named(scene: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    for name, value in scene.items():
        if isinstance(value, Mapping):
            yield from ((name, *inner) for inner in _named(value))
        else:
            yield (name,)


def _at(scene: Mapping[str, Any], path: tuple[str, ...]) -> Any:
    return _at(scene[path[0]], path[1:]) if path[1:] else scene[path[0]]


def _with(scene: Mapping[str, Any], path: tuple[str, ...], value: Any) -> dict[str, Any]:
    return {**scene, path[0]: _with(scene[path[0]], path[1:], value) if path[1:] else value}
