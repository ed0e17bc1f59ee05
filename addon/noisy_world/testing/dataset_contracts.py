# SPDX-License-Identifier: GPL-3.0-or-later
"""Contract tests of what gives and holds a dataset: sources and layouts."""

import json
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, NoisyWorldError
from ..core.file_access import read_bytes
from ..core.frame_request import FrameRequest, SensorPaths
from ..core.frame_table import FRAMES
from ..core.geometry import Intrinsics
from ..core.schema import parse
from ..core.trajectory import Trajectory, convert_convention
from ..layouts import EVERY
from ..layouts.layout import FrameNames, Layout, OutputFormat, RecordedLayout, SequenceFacts
from ..layouts.stored_recording import StoredSequence, same_camera
from ..preset.keys import check_document
from ..render.source import OpenSource, OwnRendering, RenderOptions, Source, SourceFrame
from ..sources.scene_kinds import SceneEntry, SourceKind
from ..trajectories.formats import TRAJECTORY_FORMATS
from ..trajectories.pose_files import FilePoses, PoseFile, ReadOptions, TrajectoryFormat
from .frame_contracts import CAMERA, images, path, require, require_name

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
    for k, frame_images in enumerate(whole):
        _check_images(name, source, camera, frame_images, k)
    for order in (range(count - 1, -1, -1), *([k] for k in range(count))):
        again = dict(zip(order, _frames(source, camera, path, order), strict=True))
        for k, frame_images in again.items():
            message = f"frame {k} is another when it is asked for {'alone' if len(again) == 1 else 'in another order'}"
            require(_equal(frame_images, whole[k]), name, message)
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
    for key_path in _named(scene):
        text, renamed = _at(scene, key_path), _with(scene, key_path, GONE)
        if not isinstance(text, str) or not (folder / text).exists():
            continue
        key = ".".join(key_path)
        try:
            _opened(kind, renamed, folder)
        except InputError as error:
            message = f"does not name the key {key} where its file is not there, but says: {error}"
            require(error.where.startswith(f"scenes.0.{key_path[0]}"), name, message)
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


# --- layouts ---


COUNT = 5
LOST = 2
"""Of the frames, one that has no pose where the layout allows for that."""
STAMPS_S = 1e-6
POSES = 1e-5


def check_layout(layout: Layout | RecordedLayout, folder: Path) -> None:
    """Check a layout. Raises AssertionError with the rule that it breaks.

    folder: for a layout that is written, an empty one to write into; for one of recordings, a recording of it.

    Of both: a folder without files is not recognised, its own is, and no other layout recognises that. Reading finds
    frames whose files are there, says a pose and a stamp for each, and finds the same twice; what is damaged ends with
    InputError. Of a layout that is written: names of images differ, lie inside the sequence's folder and match
    `patterns`, as text files do; what is written comes back, with its stamps, from frames.jsonl where its own files say
    none, camera, poses and depth scale; frames without a pose may be left out or kept, if it allows for `gaps`.
    """
    require(isinstance(layout, Layout | RecordedLayout), str(layout), f"is a {type(layout).__name__}, no layout")
    require_name(layout.name)
    require(layout.label and layout.meaning, layout.name, "needs a label and a meaning")
    if isinstance(layout, Layout):
        _check_written(layout, folder)
    else:
        require(layout.files, layout.name, "has to say in `files` by which files it is told")
        _check_recognised(layout, folder)
        _check_read(layout, folder)


def _check_recognised(layout: Layout | RecordedLayout, folder: Path) -> None:
    name, nothing = layout.name, folder / "no_such_folder"
    require(not layout.recognises(nothing), name, "recognises a folder that is not there")
    require(layout.recognises(folder), name, f"does not recognise its own files in {folder}")
    others = [other.name for other in EVERY.values() if other.name != name and other.recognises(folder)]
    require(
        not others, name, f"its files are recognised by {', '.join(others)} too; tell it by what others do not have"
    )


def _check_read(layout: Layout | RecordedLayout, folder: Path) -> StoredSequence:
    name = layout.name
    stored, again = layout.read(folder), layout.read(folder)
    frames = len(stored.rgb_files)
    require(frames > 0, name, "reads no frame")
    depths = len(stored.depth_files) or frames  # a recording may have none
    equal = len({frames, depths, len(stored.trajectory), len(stored.stamps.rgb.seconds)}) == 1
    require(equal, name, "reads colour, depth, poses and stamps of different numbers; each frame has one of each")
    gone = [file for file in (*stored.rgb_files, *stored.depth_files) if not file.is_file()]
    require(not gone, name, f"names {gone[:1]}, which is not there; raise InputError that names it")
    same = stored.rgb_files == again.rgb_files and np.array_equal(stored.trajectory.c2w, again.trajectory.c2w)
    require(same, name, "reads something else the second time")
    require(_colour(stored, 0).ndim == 3, name, "reads no colour")
    require(not stored.depth_files or stored.frame(0).depth_m.ndim == 2, name, "reads no depth")
    if stored.counted_hz is not None:
        slower = layout.read(folder, stored.counted_hz / 2).stamps.rgb.seconds
        took_s = np.ptp(stored.stamps.rgb.seconds)
        require(abs(np.ptp(slower) - 2 * took_s) < STAMPS_S, name, "counts frames, but not at the rate_hz it is given")
    return stored


# --- what is written ---


def _check_written(layout: Layout, folder: Path) -> None:
    name = layout.name
    require(folder.is_dir() and not any(folder.iterdir()), name, f"{folder} has to be an empty folder to write into")
    for image in layout.images:
        for colour in layout.colours:
            written = OutputFormat(layout, image, colour, ("rgb", "depth"), layout.depth_scale_per_m)
            whole = path(COUNT)
            sequence = folder / f"{image}_{colour}" / "scene"
            write_sequence(written, whole, sequence)
            _check_recognised(layout, sequence)
            _check_back(written, whole, sequence, _check_read(layout, sequence))
    written = OutputFormat(layout, layout.images[0], layout.colours[0], ("rgb", "depth"), layout.depth_scale_per_m / 2)
    whole = path(COUNT)
    scaled = folder / "scaled" / "scene"
    write_sequence(written, whole, scaled)
    _check_back(written, whole, scaled, layout.read(scaled))
    if layout.gaps:
        _check_gaps(written, folder / "gaps" / "scene")
    _check_damage(layout, scaled)


def write_sequence(written: OutputFormat, whole: Trajectory, sequence: Path) -> None:
    """Write a sequence as a run does, with frames.jsonl; check the names of its files."""
    layout, name = written.layout, written.layout.name
    facts = SequenceFacts(written, CAMERA, None, tuple(range(len(whole))), SensorPaths(whole))
    _check_names(facts.names, len(whole))
    records = []
    for frame in facts.frames:
        rgb, depth_m = images(frame)
        for file, content in (
            (facts.names.rgb(frame), written.encode_rgb(rgb)),
            (facts.names.depth(frame), written.encode_depth(depth_m)),
        ):
            _put(sequence, file, content)
        records.append(json.dumps({"frame": frame, "time_s": float(whole.stamps_s[frame]), "sha256": {}}) + "\n")
    texts = layout.sequence_texts(facts)
    require(texts == layout.sequence_texts(facts), name, "writes other text files the second time")
    for file, text in texts.items():
        _check_place(layout, file)
        _put(sequence, file, text.encode())
    for file, text in written.setting_texts(CAMERA).items():
        require(file in layout.setting_files, name, f"writes {file} for a setting, which setting_files does not name")
        _put(sequence.parent, file, text.encode())
    _put(sequence, FRAMES, "".join(records).encode())


def _put(folder: Path, name: str, content: bytes) -> None:
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(content)


def _check_names(names: FrameNames, count: int) -> None:
    layout = names.format.layout
    found = [name for frame in range(count) for name in (names.rgb(frame), names.depth(frame))]
    require(len(set(found)) == len(found), layout.name, "gives two images one name")
    for name in found:
        _check_place(layout, name)


def _check_place(layout: Layout, name: str) -> None:
    inside = PurePosixPath(name)
    require("\\" not in name and not inside.is_absolute(), layout.name, f"{name!r} is no name with forward slashes")
    require(".." not in inside.parts, layout.name, f"{name!r} leads out of the sequence's folder")
    matched = any(_matches(inside, pattern) for pattern in layout.all_patterns)
    require(matched, layout.name, f"writes {name}, which none of its patterns matches: it would never be removed")


def _matches(name: PurePosixPath, pattern: str) -> bool:
    return len(name.parts) == len(PurePosixPath(pattern).parts) and name.match(pattern)


def _check_back(written: OutputFormat, whole: Trajectory, sequence: Path, stored: StoredSequence) -> None:
    """Check that what was written is what is read."""
    layout, name = written.layout, written.layout.name
    require(len(stored.trajectory) == len(whole), name, f"reads {len(stored.trajectory)} of {len(whole)} frames")
    off_s = np.abs(stored.stamps.rgb.seconds - whole.stamps_s).max()
    message = f"reads stamps that are off by {off_s:g} s; where no file of its own says them, they are in {FRAMES}"
    require(off_s < STAMPS_S, name, message)
    off = np.abs(stored.trajectory.c2w - whole.c2w).max()
    require(off < POSES, name, f"reads poses that are off by {off:g}")
    told_poses = layout.written_poses(sequence, whole.stamps_s)
    require(np.abs(told_poses - whole.c2w).max() < POSES, name, "written_poses are not the poses that were written")
    scale, wanted = stored.depth_scale_per_m, written.depth_scale_per_m
    require(scale == wanted, name, f"reads a depth scale of {scale:g} where {wanted:g} was written")
    camera = stored.camera
    require(camera is None or same_camera(camera, CAMERA), name, f"reads the camera {camera}, not {CAMERA}")
    for frame in range(len(whole)):
        rgb, depth_m = images(frame)
        found = stored.frame(frame)
        same = np.array_equal(found.depth_m, written.stored_depth_m(depth_m))
        require(same, name, f"the depth of frame {frame} is not what was written")
        off_colour = np.abs(_colour(stored, frame).astype(float) - written.stored_rgb(rgb)).mean()
        lossy = 4.0 if written.image == "jpg" else 0.0
        require(off_colour <= lossy, name, f"the colour of frame {frame} is not what was written")


def _colour(stored: StoredSequence, frame: int) -> NDArray[Any]:
    """Return colour (H, W, 3) as the file holds it: light where it is an EXR."""
    found = stored.frame(frame)
    return found.light if found.rgb_file.suffix == ".exr" else found.rgb


def _check_gaps(written: OutputFormat, sequence: Path) -> None:
    layout, name = written.layout, written.layout.name
    known = np.arange(COUNT) != LOST
    write_sequence(written, replace(path(COUNT), posed=known), sequence)
    dropped, kept = layout.read(sequence, None, "drop"), layout.read(sequence, None, "keep")
    require(len(dropped.trajectory) == COUNT - 1, name, "poses: drop does not leave out the frame without a pose")
    whole = len(kept.trajectory) == COUNT and np.array_equal(kept.trajectory.known, known)
    require(whole, name, "poses: keep does not keep the frame without a pose, as one without")


def _check_damage(layout: Layout, sequence: Path) -> None:
    """Check that a sequence without its depth is refused, or read as one that has none."""
    copy = sequence.parent.parent / "damaged" / sequence.name
    shutil.copytree(sequence.parent, copy.parent)
    for file in layout.read(copy).depth_files:
        file.unlink()
    try:
        found = layout.read(copy)
    except InputError:
        return
    rule = "reads depth of a sequence whose depth images are gone; raise InputError that names one, or read none"
    require(not found.depth_files, layout.name, rule)


# --- trajectory formats ---


EXACT = 1e-9
"""By how much a pose, in metres and entries of its rotation, and a stamp in seconds may differ after a round trip."""


def check_trajectory_format(item: TrajectoryFormat, file: Path, folder: Path) -> None:
    """Check a trajectory format. Raises AssertionError with the rule that it breaks.

    file: one of the format, or a folder of it, with two poses or more. folder: an empty one to write into.

    A file that is missing or empty is not recognised, its own is, and no other format recognises that. Reading finds
    rigid poses, with increasing stamps or numbers, and finds the same twice; a text that is cut in its first half ends
    with InputError. What it writes, where it does, it recognises, and comes back.
    """
    require(isinstance(item, TrajectoryFormat), str(item), f"is a {type(item).__name__}, no TrajectoryFormat")
    require_name(item.name)
    name = item.name
    require(item.label and item.meaning, name, "needs a label and a meaning")
    require(item.looks_like and item.recognised_by and item.times, name, "needs the words of the table of formats")
    (folder / "empty.txt").write_text("")
    for nothing in (folder / "no_such_file", folder / "empty.txt"):
        require(not item.recognises(PoseFile(nothing)), name, f"recognises {nothing.name}, which holds no pose")
    _trajectory_formats_check_recognised(item, file)
    poses, again = (item.read(PoseFile(file), ReadOptions()) for _ in range(2))
    _check_poses(item, poses)
    require(np.array_equal(poses.poses, again.poses), name, "reads something else the second time")
    if file.is_file():
        _check_cut(item, read_bytes(file), folder / f"cut{file.suffix}")
    if item.write is not None:
        _trajectory_formats_check_written(item, folder / f"written{file.suffix}")


def _trajectory_formats_check_recognised(item: TrajectoryFormat, file: Path) -> None:
    require(item.recognises(PoseFile(file)), item.name, f"does not recognise its own file {file.name}")
    others = [
        name for name, other in TRAJECTORY_FORMATS.items() if name != item.name and other.recognises(PoseFile(file))
    ]
    require(not others, item.name, f"its file is recognised by {', '.join(others)} too; tell it by what they lack")


def _check_poses(item: TrajectoryFormat, found: FilePoses) -> None:
    name, poses = item.name, found.poses
    require(found.format == name, name, f"says that it read {found.format}")
    right = poses.dtype == np.float64 and poses.ndim == 3 and poses.shape[1:] == (4, 4) and len(poses) > 0
    require(right, name, f"reads poses of {poses.dtype} {poses.shape}, not float64 (N, 4, 4)")
    rotation = poses[:, :3, :3]
    rigid = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max() < EXACT and np.linalg.det(rotation) > 0
    require(np.all(rigid) and np.all(poses[:, 3] == [0, 0, 0, 1]), name, "reads poses that are not rigid")
    times = found.stamps_s if item.stamped else found.numbers
    require(times is not None, name, "reads no " + ("stamps" if item.stamped else "numbers of frames"))
    assert times is not None
    require(len(times) == len(poses) and np.all(np.diff(times) > 0), name, "its stamps or numbers do not increase")


def _check_cut(item: TrajectoryFormat, content: bytes, file: Path) -> None:
    """Check that a file that was cut gives fewer poses, or one line that names it."""
    file.write_bytes(content[: len(content) // 3])
    try:
        item.read(PoseFile(file), ReadOptions(declared=True))
    except InputError as error:
        require(str(file) in str(error), item.name, f"refuses a file that was cut without naming it: {error}")
    except Exception as error:
        rule = f"a file that was cut ends in {type(error).__name__}: {error}; raise InputError that names it"
        raise AssertionError(f"{item.name}: {rule}") from error


def _trajectory_formats_check_written(item: TrajectoryFormat, file: Path) -> None:
    assert item.write is not None
    whole = path(5)
    text = item.write(whole)
    require(text == item.write(whole), item.name, "writes something else the second time")
    file.write_text(text, encoding="utf-8")
    _trajectory_formats_check_recognised(item, file)
    found = item.read(PoseFile(file), ReadOptions())
    _check_poses(item, found)
    c2w = convert_convention(found.poses, direction=found.direction, axes=found.axes)
    off = np.abs(c2w - whole.c2w).max() if len(c2w) == len(whole) else np.inf
    require(off < EXACT, item.name, f"what it writes comes back {off:g} off")
    if found.stamps_s is not None:
        off_s = np.abs(found.stamps_s - whole.stamps_s).max()
        require(off_s < EXACT, item.name, f"the stamps that it writes come back {off_s:g} s off")
