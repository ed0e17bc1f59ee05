# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets that are changed, as a disk, a tool or a person may, and recipes and clean frames.

Of the area `datasets`, files and folders are replaced by links, pipes and others, or JSON is changed, and a run takes
the dataset up. Of `dataset_records`, texts of each layout are changed by structure, and the dataset is opened, asked
how far it has come, verified, described as a recipe, given to a system, or taken up.
"""

import contextlib
import functools
import hashlib
import io
import json
import os
import shutil
import threading
import warnings
from pathlib import Path

import cv2
import numpy as np
from fuzz.mutation import pick
from fuzz.structure import beside, is_sound, kept, note, text_changed
from recipes_made import frames_from_arithmetic
from recipes_made import make as make_rendered

from noisy_world.layouts import LAYOUTS
from noisy_world.core.errors import InputError, InterruptedRunError
from noisy_world.core.geometry import Intrinsics
from noisy_world.preset.keys import check_document
from noisy_world.core.progress import SilentProgress
from noisy_world.evaluate.system_input import sequence_input
from noisy_world.dataset.run import Run
from noisy_world.dataset.dataset_status import read_status
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.remaking import plan_of
from noisy_world.dataset.recipe import recipe_of
from noisy_world.dataset.opening import open_path
from noisy_world.dataset.recipe import read_recipe
from noisy_world.dataset.remaking import verify

TASK = "task.json"
TEXTS = (".json", ".jsonl", ".txt", ".csv", ".yaml")
WORDS = (
    "box", "clean", "noise", "late", "clean/box", "noise/box", "../box", "a/b/c", "rgb", "depth", "motion",
    "pairing", "sha256",
    "0" * 64, "frames", "manifest.json", "results/frame000000.png", "overview.png", "gaussian_noise", "compositor",
    "frames.jsonl",
)  # fmt: skip
MANY_FRAMES = 1000
READINGS = ("open", "open", "status", "check", "verify", "recipe", "given", "run")
RECIPE_READINGS = ("recipe_verified", "recipe_opened", "recipe_opened", "recipe_planned")


# --- a recording of a few pixels, and datasets of it ---

SIZE = (32, 24)
COUNT = 3
SETTINGS = [
    {"name": "clean"},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 2, "mode": "dynamic"}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 1}}, {"depth_gaussian_noise": None}]},
]
OURS = ("manifest.json", "run.json", "overview.png", "frames.jsonl", "traj.txt", "cam_params.json")


def write_folder(folder, rng):
    """Write a dataset's folder `out` with a change in it, what lies beside it, and what a run is to do with it."""
    stage = ("finished", "unfinished", "growing")[int(rng.integers(3))]
    shutil.copytree(_bases() / stage, folder / "out", symlinks=True)
    for place in (folder / "out", folder / "out/clean/box"):
        (place / "notes.txt").write_text("not of the dataset")
    beside(folder)
    change = mutate(folder / "out", rng)
    task = {"stage": stage, "change": change, "grown": bool(rng.random() < 0.5), "overwrite": bool(rng.random() < 0.2)}
    (folder / TASK).write_text(json.dumps(task))


def take_up(folder):
    """Have a run take the dataset up. Raises NoisyWorldError where it is refused.

    Raises AssertionError where anything is touched that is not the dataset's.
    """
    task = json.loads((folder / TASK).read_text())
    before = _others(folder)
    try:
        make(folder / "out", grown=task["grown"], overwrite=task["overwrite"])
    finally:
        after = _others(folder)
        touched = sorted({name for name, _ in set(after.items()) ^ set(before.items())})
        assert not touched, f"touched what is not the dataset's: {touched}"
    return task


def taken_up_differs(folder, meaning):
    """Compare what a run made of the dataset with one that nothing disturbed."""
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
    for path in [*folder.joinpath("outside").rglob("*"), *folder.joinpath("out").rglob("*.txt")]:
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
    folder = kept("datasets")
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


# --- changes ---


def mutate(folder, rng):
    """Change one thing in a dataset's folder; return what, in words. rng: a numpy Generator."""
    paths = _targets(folder)
    path = pick(rng, paths)
    if path.suffix in (".json", ".jsonl") and path.is_file() and not path.is_symlink() and rng.random() < 0.7:
        return f"{path.relative_to(folder)}: {text_changed(path, rng, words=WORDS)}"
    change = pick(rng, REPLACEMENTS)
    change(path, rng)
    return f"{path.relative_to(folder)}: {change.__name__.strip('_')}"


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
    root = next(parent for parent in path.parents if (parent / "outside").is_dir())
    folder = path.is_dir()
    _clear(path)
    path.symlink_to(root / "outside" if folder else root / "outside/kept.txt")


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


# --- records and recipes ---


@functools.cache
def base(layout, *, ended=True):
    """Return the folder of a sound dataset, made once in a process."""
    folder = recording() / f"records/{layout}-{ended}"
    if ended:
        make(folder, layout=layout)
    else:
        cut(folder, frames=slice(0, 2), layout=layout)
    return folder


@functools.cache
def base_recipe():
    """Return the recipe of the first layout's dataset, beside the recording that it was made from."""
    path = recording() / "recipe.json"
    path.write_text(recipe_of(base("replica"), SilentProgress()).text())
    return path


@functools.cache
def base_rendered():
    """Return a world whose frames are from arithmetic: a dataset of a mesh, its recipe and its clean frames."""
    folder = recording() / "rendered"
    with frames_from_arithmetic(), contextlib.redirect_stderr(io.StringIO()):
        settings = [{"name": "clean"}, {"name": "late", "perturb": [{"desync": {"offset": 1}}]}]
        return make_rendered(folder, settings=settings, frames=3, size=(16, 12))


def write(folder, rng):
    """Write a dataset and change one of its texts, or two."""
    beside(folder)
    _make_bases()
    ended = bool(rng.integers(5))
    layout = pick(rng, tuple(LAYOUTS))
    shutil.copytree(base(layout, ended=ended), folder / "out")
    reading = pick(rng, READINGS if ended else ("status", "check", "run"))
    told = []
    for _ in range(1 + int(rng.integers(8) == 0)):
        told += text_changed(_text(folder / "out", rng), rng, words=WORDS)
    (folder / TASK).write_text(json.dumps({"reading": reading, "ended": ended, "layout": layout}))
    note(folder, told)


def write_recipe(folder, rng):
    """Write a recipe of a recording, or of a mesh with its clean frames, and change it."""
    beside(folder)
    _make_bases()
    reading = pick(rng, RECIPE_READINGS)
    clean = reading == "recipe_opened" and bool(rng.integers(2))
    shutil.copy(base_rendered().recipe if clean else base_recipe(), folder / "recipe.json")
    path = folder / "recipe.json"
    if clean:
        shutil.copytree(base_rendered().clean, folder / "clean")
        path = pick(rng, [path, *[folder / "clean/clean.json"] * 2])
    told = text_changed(path, rng, words=WORDS)
    (folder / TASK).write_text(json.dumps({"reading": reading, "clean": clean}))
    note(folder, told)


@functools.cache
def _make_bases():
    """Make what inputs are changed from, and held against, before the first of them is read."""
    for layout in LAYOUTS:
        _sound_frames(base(layout))
        base(layout, ended=False)
    base_recipe()
    base_rendered()


def _text(out, rng):
    """Return a text of a dataset, those that decide what is there more often."""
    work = out / ".noisy_world"
    telling = [out / "manifest.json", *work.glob("identity.json"), *work.rglob("journal-*.jsonl")]
    texts = [path for path in sorted(out.rglob("*")) if path.suffix in TEXTS and path.is_file()]
    return pick(rng, [path for path in telling * 5 if path.exists()] + texts)


def read(folder):
    """Read the dataset or the recipe as the task says."""
    task = json.loads((folder / TASK).read_text())
    out = folder / "out"
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*made with")  # a recipe of other versions is said to be one
        return READERS[task["reading"]](folder, out)


def _opened(opened):
    """Read every frame of what is open."""
    found = {}
    with opened:
        for name in opened:
            sequence = opened[name]
            if len(sequence) > MANY_FRAMES:
                raise InputError(opened.place, "has many frames")
            for frame in sequence:
                assert np.isfinite(frame.c2w).all()
                assert frame.c2w.shape == (4, 4)
                assert np.isfinite((frame.stamp_s, frame.depth_stamp_s)).all()
                assert isinstance(frame.done, dict)
                found[name, frame.index] = (frame.rgb, frame.depth_m)
    return found


def _status(_folder, out, *, check=False):
    status = read_status(out, SilentProgress(), check=check)
    for each in status.sequences:
        assert each.of is None or 0 <= each.inventory.done <= each.of
    return status


def _given(_folder, out):
    found = {}
    for setting in sorted(path for path in out.iterdir() if path.is_dir() and not path.name.startswith(".")):
        for scene in sorted(path for path in setting.iterdir() if path.is_dir()):
            asked = Intrinsics(*SIZE, 16.0, 16.0, 15.5, 11.5)
            found[scene.name] = sequence_input(scene, camera=asked).document(out.parent / "given")
    return found


def _run(folder, out):
    make(out, layout=_layout_of(folder))


def _layout_of(folder):
    """Return the layout of a case's dataset."""
    return json.loads((folder / TASK).read_text())["layout"]


def _recipe(_folder, out):
    text = recipe_of(out, SilentProgress()).text()
    assert json.loads(text)["sequences"].keys() <= {"clean/box", "noise/box", "late/box"}


def _verify(_folder, out):
    # the recipe is of another layout, so all is told to be otherwise, in lines
    findings = verify(read_recipe(base_recipe()), out, SilentProgress(), threading.Event())
    return [*findings.lines(), *findings.summary_lines()]


def _recipe_planned(folder, _out):
    recipe = read_recipe(folder / "recipe.json")
    plan_of(recipe, recording())
    again = json.loads(recipe.text())
    assert json.loads(json.dumps(again)) == again
    return recipe


def _recipe_verified(folder, _out):
    findings = verify(read_recipe(folder / "recipe.json"), base("replica"), SilentProgress(), threading.Event())
    return [*findings.lines(), *findings.summary_lines()]


def _recipe_opened(folder, _out):
    clean = folder / "clean"
    if clean.is_dir():
        return _opened(open_path(folder / "recipe.json", clean, base_rendered().recipe.parent))
    return _opened(open_path(folder / "recipe.json", None, recording()))


READERS = {
    "open": lambda _folder, out: _opened(open_path(out)),
    "status": _status,
    "check": functools.partial(_status, check=True),
    "given": _given,
    "run": _run,
    "recipe": _recipe,
    "verify": _verify,
    "recipe_planned": _recipe_planned,
    "recipe_verified": _recipe_verified,
    "recipe_opened": _recipe_opened,
}


def differs(folder, meaning):
    """Say how frames that were read differ from those of the sound dataset, and what else was touched."""
    if (folder / "outside/kept.txt").read_text() != "somebody's":
        return "wrote outside of its folder"
    task = json.loads((folder / TASK).read_text())
    if task["reading"] == "recipe_opened":
        sound = _sound_frames(base_rendered().out if task["clean"] else base("replica"))
    elif task["reading"] == "open":
        sound = _sound_frames(base(_layout_of(folder)))
    else:
        lines = meaning if task["reading"] in ("verify", "recipe_verified") else []
        wrong = next((line for line in lines if not line.isprintable()), "")
        return f"not one line: {wrong!r}" if wrong else ""
    if is_sound(folder) and meaning.keys() != sound.keys():
        return f"other frames: {sorted(meaning)}"
    for key in meaning.keys() & sound.keys() if is_sound(folder) else ():
        if not all(np.array_equal(ours, theirs) for ours, theirs in zip(meaning[key], sound[key], strict=True)):
            return f"other pixels: {key}"
    return ""


@functools.cache
def _sound_frames(out):
    return _opened(open_path(out))
