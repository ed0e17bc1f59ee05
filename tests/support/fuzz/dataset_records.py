# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets in each layout that is written, whose records and texts are changed by structure; and clean frames.

A dataset is opened, asked how far it has come, verified, described as a recipe, given to a system,
or taken up by a run.
"""

import contextlib
import functools
import io
import json
import shutil
import threading
import warnings

import numpy as np
from fuzz import dataset_folders
from fuzz.dataset_folders import cut, make, recording
from fuzz.mutation import pick
from fuzz.structure import as_json, as_lines, as_table, as_yaml, changed, is_sound, note
from recipes_made import frames_from_arithmetic
from recipes_made import make as make_rendered

from noisy_world.core.datasets.layouts import LAYOUTS
from noisy_world.core.errors import InputError
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.progress import SilentProgress
from noisy_world.evaluation.systems.index import given_sequence
from noisy_world.perturbations import registry
from noisy_world.pipeline.status import read_status
from noisy_world.recipes.making import plan_of
from noisy_world.recipes.of_dataset import recipe_of
from noisy_world.recipes.opening import open_path
from noisy_world.recipes.recipe import read_recipe
from noisy_world.recipes.verifying import verify

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
    (folder / "outside").mkdir()
    (folder / "outside/kept.txt").write_text("somebody's")
    _make_bases()
    ended = bool(rng.integers(5))
    layout = pick(rng, tuple(LAYOUTS))
    shutil.copytree(base(layout, ended=ended), folder / "out")
    reading = pick(rng, READINGS if ended else ("status", "check", "run"))
    told = []
    for _ in range(1 + int(rng.integers(8) == 0)):
        told += _text_changed(_text(folder / "out", rng), rng)
    (folder / TASK).write_text(json.dumps({"reading": reading, "ended": ended, "layout": layout}))
    note(folder, told)


def write_recipe(folder, rng):
    """Write a recipe of a recording, or of a mesh with its clean frames, and change it."""
    (folder / "outside").mkdir()
    (folder / "outside/kept.txt").write_text("somebody's")
    _make_bases()
    reading = pick(rng, RECIPE_READINGS)
    clean = reading == "recipe_opened" and bool(rng.integers(2))
    shutil.copy(base_rendered().recipe if clean else base_recipe(), folder / "recipe.json")
    path = folder / "recipe.json"
    if clean:
        shutil.copytree(base_rendered().clean, folder / "clean")
        path = pick(rng, [path, *[folder / "clean/clean.json"] * 2])
    told = _text_changed(path, rng)
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


def _text_changed(path, rng):
    """Change a text by its structure; return the changes."""
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix in (".json", ".jsonl"):
        lines = path.suffix == ".jsonl"
        try:
            tree = [json.loads(line) for line in text.splitlines()] if lines else json.loads(text)
        except (ValueError, RecursionError):  # changed before
            return ["is no JSON any more"]
        tree, told = changed(tree, rng, words=WORDS)
        data = as_lines(tree) if lines else as_json(tree, indent=2)
    elif path.suffix == ".yaml" and not text.startswith("%"):
        tree, told = changed(_yaml(text), rng, words=WORDS)
        data = as_yaml(tree, flow=bool(rng.integers(2)))
    else:
        separator = "," if path.suffix == ".csv" else " "
        tree, told = changed([line.split(separator) for line in text.splitlines()], rng, words=WORDS)
        data = as_table(tree, separator)
    if told:
        path.write_bytes(data)
    return [f"{path.name}: {each}" for each in told]


def _yaml(text):
    import yaml

    return yaml.safe_load(text)


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
    status = read_status(out, registry(), SilentProgress(), check=check)
    for each in status.sequences:
        assert each.of is None or 0 <= each.inventory.done <= each.of
    return status


def _given(_folder, out):
    found = {}
    for setting in sorted(path for path in out.iterdir() if path.is_dir() and not path.name.startswith(".")):
        for scene in sorted(path for path in setting.iterdir() if path.is_dir()):
            asked = Intrinsics(*dataset_folders.SIZE, 16.0, 16.0, 15.5, 11.5)
            found[scene.name] = given_sequence(scene, camera=asked).document(out.parent / "given")
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


def differs(folder, meaning, peer=None):
    """Say how frames that were read differ from those of the sound dataset, and what else was touched."""
    del peer
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
