# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes a dataset's folder as a disk, a tool or a person may: links, folders for files, JSON that nobody wrote.

`mutate` makes one change, which its generator decides alone. `write` makes a dataset of a recording of a few pixels,
finished, unfinished or growing, and changes it; `read` has a run take it up, and `differs` compares what came of it.
"""

import contextlib
import functools
import hashlib
import json
import os
import shutil
import tempfile
import threading
from pathlib import Path

import cv2
import numpy as np

from noisy_world.core.errors import InterruptedRunError
from noisy_world.core.presets.preset import check_document
from noisy_world.core.progress import SilentProgress
from noisy_world.pipeline.run import Run
from noisy_world.planning import make_plan

OUTSIDE = "outside"  # a folder beside the dataset's, which nothing may touch
VALUES = (
    None, True, False, 0, -1, 1, 2, 7, 1e308, -0.5, 10**30, 10**400, "", "x", "../x", "../../outside/kept.txt",
    "/etc/passwd", "clean/box", "..", "\n", "\x00", "a" * 5000, [], {}, [[]], {"": {}}, [1, 2, 3], {"a": "../x"},
)  # fmt: skip
RAW = (
    b"NaN", b"Infinity", b"-Infinity", b"1e999", b"-1e999", b"9" * 5000, b'"\\ud800"', b"[" * 3000 + b"]" * 3000,
    b'{"a":' * 2000 + b"1" + b"}" * 2000, b"\xff\xfe", b"{", b"]", b"", b"\xc3\x28", b'"\xed\xa0\x80"', b"0x10", b"'a'",
)  # fmt: skip


# --- datasets ---

SIZE = (32, 24)
COUNT = 3
SETTINGS = [
    {"name": "clean"},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 2, "mode": "dynamic"}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 1}}, {"depth_gaussian_noise": None}]},
]
OURS = ("manifest.json", "run.json", "overview.png", "frames.jsonl", "traj.txt", "cam_params.json")


def write(folder, rng):
    """Write a dataset's folder `out` with a change in it, what lies beside it, and what a run is to do with it."""
    stage = ("finished", "unfinished", "growing")[int(rng.integers(3))]
    shutil.copytree(_bases() / stage, folder / "out", symlinks=True)
    for place in (folder / "out", folder / "out/clean/box"):
        (place / "notes.txt").write_text("not of the dataset")
    (folder / OUTSIDE).mkdir()
    (folder / OUTSIDE / "kept.txt").write_text("somebody's")
    change = mutate(folder / "out", rng)
    task = {"stage": stage, "change": change, "grown": bool(rng.random() < 0.5), "overwrite": bool(rng.random() < 0.2)}
    (folder / "task.json").write_text(json.dumps(task))


def read(folder):
    """Have a run take the dataset up. Raises NoisyWorldError where it is refused.

    Raises AssertionError where anything is touched that is not the dataset's.
    """
    task = json.loads((folder / "task.json").read_text())
    before = _others(folder)
    try:
        make(folder / "out", grown=task["grown"], overwrite=task["overwrite"])
    finally:
        after = _others(folder)
        touched = sorted({name for name, _ in set(after.items()) ^ set(before.items())})
        assert not touched, f"touched what is not the dataset's: {touched}"
    return task


def differs(folder, meaning, peer=None):
    """Compare what a run made of the dataset with one that nothing disturbed."""
    del peer
    whole = _described(_bases() / ("grown" if meaning["grown"] or meaning["stage"] == "growing" else "finished"))
    made = _described(folder / "out")
    wanted = {name: value for name, value in whole.items() if meaning["grown"] or name.split("/")[0] != "dim"}
    made = {name: value for name, value in made.items() if name in wanted or name not in whole}
    lost = sorted(name for name, value in wanted.items() if made.get(name) != value and name not in LOOSE)
    added = sorted(
        name
        for name in set(made) - set(whole)
        if Path(name).name not in ("notes.txt", "mine.txt") and (meaning["grown"] or not name.startswith("dim"))
    )
    return f"other bytes: {lost}" if lost else f"added: {added}" if added else ""


LOOSE = ("manifest.json", "overview.png")  # they also tell what the preset does not name


def _described(out):
    """What lies in a dataset by name: hashes, and of records all but what was done, which no hash of theirs covers."""
    found = {}
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        if path.is_file() and not name.startswith(".noisy_world/") and name != "run.json":
            data = path.read_bytes()
            found[name] = hashlib.sha256(data).hexdigest()
            if path.name == "frames.jsonl":
                with contextlib.suppress(ValueError, KeyError, TypeError):  # of a sequence that a run did not take up
                    records = [json.loads(line) for line in data.splitlines()]
                    found[name] = [(record["frame"], record["time_s"], record["sha256"]) for record in records]
    return found


def _others(folder):
    """The files that are not the dataset's, with their content; a link by where it leads."""
    found = {}
    for path in [*folder.joinpath(OUTSIDE).rglob("*"), *folder.joinpath("out").rglob("*.txt")]:
        if path.name not in OURS and path.is_file() and not path.is_symlink():
            found[path.relative_to(folder).as_posix()] = path.read_bytes()
    return found


class _CutRun(Run):
    """A run that ends, as if killed, when its frames are written and nothing else is."""

    def _seal(self, start_s):
        raise InterruptedRunError("stopped")


def make(out, *, grown=False, overwrite=False, frames=None, kind=Run, layout="replica"):
    settings = [{"name": "dim", "perturb": [{"brightness": None}]}, *SETTINGS] if grown else SETTINGS
    document = {
        "scenes": [{"name": "box", "sequence": "recording"}],
        "camera": {"width": SIZE[0], "height": SIZE[1], "fx": 16.0, "fy": 16.0, "cx": 15.5, "cy": 11.5},
        "render": {"backend": "reference"},
        "settings": settings,
        "output": {"layout": layout, "image": "png", "overview": True},
    }
    plan = make_plan(check_document(document, recording() / "preset.yaml"), frames)
    kind(plan, out, progress=SilentProgress(), stop=threading.Event(), overwrite=overwrite).make_dataset()


@functools.cache
def recording():
    """A folder with a recording of a few pixels; it lasts as long as the process."""
    keeper = tempfile.TemporaryDirectory(prefix="dataset-folders-")
    _KEPT.append(keeper)
    folder = Path(keeper.name)
    results = folder / "recording/results"
    results.mkdir(parents=True)
    rng = np.random.default_rng(1)
    rows = []
    for k in range(COUNT):
        cv2.imwrite(str(results / f"frame{k:06d}.png"), rng.integers(0, 256, (SIZE[1], SIZE[0], 3), np.uint8))
        cv2.imwrite(str(results / f"depth{k:06d}.png"), rng.integers(1, 60000, (SIZE[1], SIZE[0]), np.uint16))
        rows.append(f"1 0 0 {k} 0 1 0 0 0 0 1 0 0 0 0 1\n")
    (folder / "recording/traj.txt").write_text("".join(rows))
    return folder


@functools.cache
def _bases():
    """The datasets that are changed, made once in a process, by the names of their stages."""
    folder = recording() / "bases"
    for stage, grown in (("finished", False), ("grown", True)):
        make(folder / stage, grown=grown)
    cut(folder / "unfinished", frames=slice(0, 2))
    make(folder / "growing")
    cut(folder / "growing", grown=True, frames=slice(0, 2))
    return folder


def cut(out, **options):
    with contextlib.suppress(InterruptedRunError):
        make(out, kind=_CutRun, **options)


_KEPT = []


# --- changes ---


def mutate(folder, rng):
    """Change one thing in a dataset's folder; return what, in words. rng: a numpy Generator."""
    paths = _targets(folder)
    path = paths[int(rng.integers(len(paths)))]
    is_json = path.suffix in (".json", ".jsonl") and path.is_file() and not path.is_symlink()
    if is_json and rng.random() < 0.7:
        change = (_json_value, _json_raw, _json_key, _json_line)[int(rng.integers(4))]
    else:
        change = REPLACEMENTS[int(rng.integers(len(REPLACEMENTS)))]
    return f"{path.relative_to(folder)}: {change.__name__.strip('_')} {change(path, rng) or ''}"


def _targets(folder):
    """The files and folders of a dataset, those that decide what is there first among them and several times."""
    work = folder / ".noisy_world"
    telling = [folder / "manifest.json", *sorted(work.glob("identity.json")), *sorted(work.rglob("journal-*.jsonl"))]
    telling += sorted(folder.glob("*/*/frames.jsonl"))
    rest = [path for path in sorted(folder.rglob("*")) if path.name not in ("notes.txt",)]
    return [path for path in telling * 8 if os.path.lexists(path)] + [*rest, work, work / "lock"]


# --- files replaced ---


def _clear(path):
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)


def _folder(path, rng):
    _clear(path)
    path.mkdir()
    if rng.random() < 0.5:
        (path / "mine.txt").write_text("mine")


def _dangling_link(path, rng):
    _clear(path)
    path.symlink_to(f"nowhere-{rng.integers(10)}")


def _loop(path, rng):
    del rng
    _clear(path)
    path.symlink_to(path.name)


def _link_outside(path, rng):
    del rng
    root = next(parent for parent in path.parents if (parent / OUTSIDE).is_dir())
    folder = path.is_dir()
    _clear(path)
    path.symlink_to(root / OUTSIDE if folder else root / OUTSIDE / "kept.txt")


def _pipe(path, rng):
    del rng
    _clear(path)
    os.mkfifo(path)


def _remove(path, rng):
    del rng
    _clear(path)


def _empty(path, rng):
    del rng
    _clear(path)
    path.write_bytes(b"")


def _truncate(path, rng):
    data = _bytes(path)
    _clear(path)
    path.write_bytes(data[: int(rng.integers(len(data) + 1))])


def _flip(path, rng):
    data = bytearray(_bytes(path))
    for _ in range(int(rng.integers(1, 4))):
        if data:
            data[int(rng.integers(len(data)))] = int(rng.integers(256))
    _clear(path)
    path.write_bytes(bytes(data))


def _noise(path, rng):
    _clear(path)
    path.write_bytes(rng.bytes(int(rng.integers(1, 200))))


def _bytes(path):
    return path.read_bytes() if path.is_file() else b"a file"


REPLACEMENTS = (_folder, _dangling_link, _loop, _link_outside, _pipe, _remove, _empty, _truncate, _flip, _noise)


# --- JSON changed ---


def _documents(path):
    """The JSON values of a file: one, or one a line."""
    text = path.read_text(encoding="utf-8", errors="replace")
    return [json.loads(line) for line in text.splitlines()] if path.suffix == ".jsonl" else [json.loads(text)]


def _write(path, documents):
    lines = path.suffix == ".jsonl"
    path.write_text("".join(json.dumps(value, indent=None if lines else 2) + "\n" for value in documents))


def _nodes(value, found):
    """All (container, key) of a JSON value."""
    for name, inside in list(value.items() if isinstance(value, dict) else enumerate(value)):
        found.append((value, name))
        if isinstance(inside, (dict, list)):
            _nodes(inside, found)
    return found


def _picked(path, rng):
    documents = _documents(path)
    nodes = [node for value in documents if isinstance(value, (dict, list)) for node in _nodes(value, [])]
    return documents, nodes[int(rng.integers(len(nodes)))] if nodes else (None, None)


def _json_value(path, rng):
    documents, (container, name) = _picked(path, rng)
    if container is None:
        return _noise(path, rng)
    container[name] = VALUES[int(rng.integers(len(VALUES)))]
    _write(path, documents)
    return f"{name} = {str(container[name])[:40]!r}"


def _json_raw(path, rng):
    documents, (container, name) = _picked(path, rng)
    if container is None:
        return _noise(path, rng)
    container[name] = "a place for raw bytes"
    _write(path, documents)
    raw = RAW[int(rng.integers(len(RAW)))]
    path.write_bytes(path.read_bytes().replace(b'"a place for raw bytes"', raw))
    return f"{name} = {raw[:40]!r}"


def _json_key(path, rng):
    documents, (container, name) = _picked(path, rng)
    if container is None:
        return _noise(path, rng)
    value = container.pop(name)
    if isinstance(container, dict) and rng.random() < 0.7:
        container[str(VALUES[int(rng.integers(len(VALUES)))])[:300]] = value
    _write(path, documents)
    return str(name)


def _json_line(path, rng):
    """Repeat, lose or mix up the lines, or the whole document."""
    documents = _documents(path)
    if not documents:
        return _noise(path, rng)
    documents.insert(int(rng.integers(len(documents) + 1)), documents[int(rng.integers(len(documents)))])
    if rng.random() < 0.5:
        del documents[int(rng.integers(len(documents)))]
    _write(path, documents)
    return f"{len(documents)} documents"
