# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether a layout keeps its contract."""

import json
import shutil
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.datasets.layouts import EVERY
from ..core.datasets.layouts.layout import FrameNames, Layout, OutputFormat, SequenceFacts
from ..core.datasets.layouts.recorded import RecordedLayout
from ..core.datasets.records import FRAMES
from ..core.datasets.stored import StoredSequence, same_camera
from ..core.errors import InputError
from ..core.trajectories.sensor_paths import SensorPaths
from ..core.trajectories.trajectory import Trajectory
from .rules import CAMERA, images, path, require, require_name

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
    matched = any(_matches(inside, pattern) for pattern in layout.patterns)
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
    """Check that a sequence without its depth is refused."""
    copy = sequence.parent.parent / "damaged" / sequence.name
    shutil.copytree(sequence.parent, copy.parent)
    for file in layout.read(copy).depth_files:
        file.unlink()
    try:
        layout.read(copy)
    except InputError:
        return
    require(False, layout.name, "reads a sequence whose depth images are gone; raise InputError that names one")
