# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings of every layout whose texts are changed by structure, and whose files are renamed, lost and mixed up."""

import json

import yaml
from fuzz import recorded, recordings
from fuzz.mutation import pick
from fuzz.structure import OF_NUMBERS, as_json, as_table, as_yaml, changed, note, raws

LAYOUTS = (
    recordings.replica, recordings.tum, recordings.euroc, recordings.vslamlab, *recorded.WRITERS
)  # fmt: skip
WORDS = (
    "camera", "fx", "scale", "timestamp", "rgb/", "depth/", "../sequence/traj.txt", "data.csv", "radial-tangential",
    "PINHOLE",
    "1403636579760000000", "OPENCV_FISHEYE", "m_depthShift", "=", "frames", "file_path", "k1", "nan",
)  # fmt: skip
RAWS = raws(*OF_NUMBERS, b"-inf", b"#", b"1,5", b"\xef\xbb\xbf")


def write(folder, rng):
    """Write a recording, and change some of its texts or files."""
    sequence = folder / "sequence"
    sequence.mkdir()
    (folder / "outside").mkdir()
    (folder / "outside/kept.txt").write_text("somebody's")
    pick(rng, LAYOUTS)(sequence, rng)
    told = []
    texts = sorted(path for path in sequence.rglob("*") if path.suffix in recordings.TEXTS)
    for _ in range(int(rng.integers(1, 3))):
        if rng.integers(5) == 0:
            told.append(_files_changed(sequence, rng))
        else:
            told += _text_changed(pick(rng, texts), rng)
    task = {"poses": pick(rng, ("drop", "drop", "keep", "none", "require"))} if told else {"poses": "drop"}
    task |= {name: bool(told) and bool(rng.random() < 0.2) for name in ("undistort", "register")}
    (folder / recordings.TASK).write_text(json.dumps(task))
    (folder / recordings.CUT).write_text("[]")
    note(folder, told)


def _text_changed(path, rng):
    """Change a text file by its structure; return the changes."""
    if not path.is_file():
        return []
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix == ".json":
        tree, told = _parsed(json.loads, text)
        tree, told = changed(tree, rng, words=WORDS) if told is None else (tree, told)
        data = as_json(tree, indent=1)
    elif path.suffix == ".yaml":
        tree, told = _parsed(yaml.safe_load, text)
        tree, told = changed(tree, rng, words=WORDS) if told is None else (tree, told)
        data = b"%YAML 1.2\n---\n" * (text[:1] == "%") + as_yaml(tree, flow=bool(rng.integers(2)))
    else:
        separator = "," if path.suffix == ".csv" else " = " if path.name == "info.txt" else " "
        rows = [line.split(separator) for line in text.splitlines()]
        tree, told = changed(rows, rng, raws=RAWS, words=WORDS)
        data = as_table(tree, separator)
    if told:
        path.write_bytes(data)
    return [f"{path.name}: {each}" for each in told]


def _parsed(reader, text):
    """Return the tree of a text; of one that was changed before and is no tree any more, an empty one, and why."""
    try:
        return reader(text), None
    except (ValueError, RecursionError, yaml.YAMLError):
        return {}, ["is no tree any more"]


def _files_changed(sequence, rng):
    """Rename, remove, repeat or replace a file of a recording; return what was done."""
    paths = sorted(path for path in sequence.rglob("*") if path.is_file() and not path.is_symlink())
    if not paths:
        return "nothing is left"
    path, other = pick(rng, paths), pick(rng, paths)
    data = path.read_bytes()
    match int(rng.integers(8)):
        case 0:
            path.unlink()
        case 1:
            path.replace(path.with_name(pick(rng, ("x", "é", "a" * 200, "-1", "1e3", "000000", " ")) + path.suffix))
        case 2:
            path.with_name(path.stem + "0" + path.suffix).write_bytes(data)
        case 3:
            path.write_bytes(other.read_bytes())
        case 4:
            path.unlink()
            path.mkdir()
        case 5:
            path.unlink()
            path.symlink_to(other)
        case 6:
            path.replace(path.with_suffix(path.suffix.upper()))
        case _:
            path.with_suffix(".bak").write_bytes(data)
            path.write_bytes(b"")
    return f"{path.name}: another file"


read = recordings.read
differs = recordings.differs
