# SPDX-License-Identifier: GPL-3.0-or-later
"""Every field of a dataset's and a recipe's JSON, null, nested, of a wrong type or huge: one line, no traceback."""

import copy
import itertools
import json
import sys
import threading

import pytest
from recipes_made import frames_from_arithmetic
from worlds import write_world
from runs import run

from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.dataset_status import read_status
from noisy_world.dataset.recipe import read_recipe, recipe_of
from noisy_world.dataset.remaking import verify
from noisy_world.dataset.stored import finished_folder

VALUES = (None, True, -1, 1.5, 10**30, "", "../../x", "f" * 300, [], {}, [[]], [None], {"": None}, {"a": {"b": []}})
WRONG_FILE = "does not tell a name inside the dataset and its SHA-256 of"
FREE = ("preset", "conventions", "notes")  # what people are told, and no program reads
SETTINGS = [{"name": "clean"}, {"name": "mix", "perturb": [{"fog": {"severity": 3}}, {"desync": {"offset": 1}}]}]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fields")
    with frames_from_arithmetic():
        run(write_world(folder / "world", frames=2, size=(8, 6), settings=SETTINGS), folder / "out")
    (folder / "a.recipe").write_text(recipe_of(folder / "out", PlainProgress(sys.stderr)).text())
    return folder / "out", folder / "a.recipe"


def fields(value, at=()):
    """Yield the keys that lead to each field, of lists to the first two items."""
    if at:
        yield at
    items = value.items() if isinstance(value, dict) else enumerate(value[:2]) if isinstance(value, list) else ()
    for key, inside in items:
        if key not in FREE:
            yield from fields(inside, (*at, key))


def changes(document, each):
    """Yield the document with one field changed at a time, to some of the values, in turn."""
    values = itertools.cycle(VALUES)
    for at in fields(document):
        for value in itertools.islice(values, each):
            changed = copy.deepcopy(document)
            node = changed
            for key in at[:-1]:
                node = node[key]
            node[at[-1]] = value
            yield at, value, changed


def said(act, *about):
    """Return what is said of a change, in a line; "" where it does not matter."""
    line = ""
    try:
        act()
    except NoisyWorldError as error:
        line = str(error)
    except Exception as error:
        raise AssertionError(f"a traceback: {about}") from error
    assert "\n" not in line, about
    return line


@pytest.mark.one_python
def test_every_field_of_a_recipe(dataset):
    out, path = dataset
    text = path.read_text()

    def act():
        verify(read_recipe(path), out, PlainProgress(sys.stderr), threading.Event())

    refused = 0
    for at, value, changed in changes(json.loads(text), 5):
        path.write_text(json.dumps(changed))
        refused += str(path) in said(act, at, value)
    path.write_text(text)
    assert refused > 100


@pytest.mark.one_python
@pytest.mark.parametrize("name", ["manifest.json", "run.json", "mix/box/frames.jsonl"])
def test_every_field_of_a_dataset(name, dataset):
    out, _ = dataset
    quiet, path = PlainProgress(sys.stderr), out / name
    text = path.read_text()
    first, *rest = text.splitlines() if name.endswith("l") else [text]
    acts = (
        lambda: read_status(out, quiet, check=True),
        lambda: recipe_of(out, quiet),
        lambda: [finished_folder(out).frames(sequence) for sequence in finished_folder(out).sequences],
    )
    for number, (at, value, changed) in enumerate(changes(json.loads(first), 3)):
        path.write_text("\n".join([json.dumps(changed), *rest]) + "\n")
        said(acts[number % len(acts)], at, value)
    path.write_text(text)


@pytest.mark.parametrize(
    ("at", "value", "told"),
    [
        (("files", "clean/box", "traj.txt"), "../../x", f"{WRONG_FILE} 'traj.txt'"),
        (("files", "clean/box", "traj.txt"), "0" * 63, f"{WRONG_FILE} 'traj.txt'"),
        (("files", "clean/box", "../../../x"), "0" * 64, f"{WRONG_FILE} '../../../x'"),
        (("files", "clean/box"), {}, "does not name the frames.jsonl of each sequence"),
        (("identity", "scenes", "box", "path", "frames"), 10**30, "lacks what an identity holds"),
        (("identity", "processor", "features"), None, "lacks what an identity holds"),
        (("identity", "processor", "features"), [["AVX2"]], "lacks what an identity holds"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_manifest_is_told(at, value, told, dataset):
    out, _ = dataset
    path = out / "manifest.json"
    text = path.read_text()
    document = json.loads(text)
    node = document
    for key in at[:-1]:
        node = node[key]
    node[at[-1]] = value
    path.write_text(json.dumps(document))
    assert f"manifest.json {told}" in said(lambda: finished_folder(out), at)
    path.write_text(text)


def test_a_recipe_of_endless_frames_is_refused_at_once(dataset):
    _, path = dataset
    text = path.read_text()
    for frames in ([[0, 10**30]], [[0, 10**9]], [[0, 2], [1, 3]], [[2, 0]], [[0, 1.5]], []):
        document = json.loads(text)
        document["sequences"]["clean/box"]["frames"] = frames
        path.write_text(json.dumps(document))
        assert "is damaged: it lacks what a recipe holds" in said(lambda: read_recipe(path), frames)
    path.write_text(text)
