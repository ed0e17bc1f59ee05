# SPDX-License-Identifier: GPL-3.0-or-later
"""A recipe is small and the same each time; holding a dataset against it finds what is not as it was."""

import hashlib
import base64
import json
import re
import shutil
import threading

import pytest
from cases import cases
from recipes_made import progress
from refusals import refused
from recipes_made import noisy_world as command

from noisy_world.dataset.recipe import BLOCK_FRAMES, FrameNumbers, blocks_of, read_recipe, recipe_of
from noisy_world.dataset.remaking import verify

LATE = "late/box/results"


@pytest.fixture
def copy(made, tmp_path):
    shutil.copytree(made.out, tmp_path / "copy")
    return tmp_path / "copy"


def found(made, folder):
    return verify(read_recipe(made.recipe), folder, progress(), threading.Event())


# --- the recipe ---


def test_digests_are_those_of_lists_of_hashes(made):
    content = json.loads(made.recipe.read_text())
    row = content["sequences"]["late/box"]
    assert row["frames"] == [[0, 9]]
    files = sorted((made.out / LATE).glob("depth*.png"))
    lines = "".join(f"{hashlib.sha256(file.read_bytes()).hexdigest()} results/{file.name}\n" for file in files)
    wanted = base64.urlsafe_b64encode(hashlib.sha256(lines.encode()).digest()[:15]).decode()
    assert row["images"]["results/depth*.png"] == wanted
    assert row["images"]["results/frame*.jpg"] == "adrift/box", "the first by name with the same colour"
    poses = hashlib.sha256((made.out / "late/box/traj.txt").read_bytes()).digest()[:15]
    assert row["texts"]["traj.txt"] == base64.urlsafe_b64encode(poses).decode()
    assert content["identity"] == json.loads((made.out / "manifest.json").read_text())["identity"]


def test_a_recipe_is_the_same_each_time_and_is_read_as_it_was(made, tmp_path, capfd):
    assert command("recipe", made.out) == 0
    assert capfd.readouterr().out == made.recipe.read_text()
    assert command("recipe", made.out, "--out", tmp_path / "again.json") == 0
    assert (tmp_path / "again.json").read_text() == made.recipe.read_text()
    assert read_recipe(made.recipe).text() == made.recipe.read_text()


@cases(
    ("pattern", "by", "words"),
    [
        ('"kind":"recipe of Noisy World"', '"kind":"x"', "is no recipe"),
        ('"format": 1', '"format": 2', "another version"),
        (r'"frames":\[\[0,9\]\]', '"frames":[[0,900]]', "is damaged"),
        (r'"frames":\[\[0,9\]\]', '"frames":[[0,9000000000000000000]]', "is damaged"),
        (r'"frames":\[\[0,9\]\]', '"frames":[[0,1e15]]', "is damaged"),
        (r'"frames":\[\[0,9\]\]', '"frames":[[4,9],[0,4]]', "is damaged"),
        (r'"clean/box": *\{', '"clean":{', "is damaged"),
        (r'"texts":\{"frames.jsonl"', '"text":{"frames.jsonl"', "is damaged"),
        ('"clean/box":', '"clean/hall":', "sequences"),
        (r'"features":\[', '"features":[{},', "identity: "),
        (r'"features":\[', '"feature":[', "identity: "),
        (r"\{\n", "[\n", "cannot be read at line"),
    ],
)
def test_what_is_no_recipe_is_refused(made, tmp_path_factory, pattern, by, words):
    path = tmp_path_factory.mktemp("damaged") / "recipe.json"
    text, count = re.subn(pattern, by, made.recipe.read_text().replace('"kind": ', '"kind":'), count=1)
    assert count == 1
    path.write_text(text)
    refused(read_recipe, path, names=("recipe.json: ", words))


def test_only_a_finished_dataset_has_a_recipe(made, copy, tmp_path):
    refused(recipe_of, tmp_path / "none", progress(), names="no dataset")
    with (copy / "clean/box/frames.jsonl").open("a") as file:
        file.write("\n")
    refused(recipe_of, copy, progress(), names="frames.jsonl: ")
    (copy / "manifest.json").unlink()
    refused(recipe_of, copy, progress(), names="manifest.json is missing")


def test_numbers_of_frames():
    numbers = FrameNumbers.of([0, 1, 2, 5, 9, 10])
    assert (len(numbers), list(numbers), numbers[3], numbers[-1]) == (6, [0, 1, 2, 5, 9, 10], 5, 10)
    assert (5 in numbers, 3 in numbers, str(numbers)) == (True, False, "0 to 2, 5, 9 to 10")
    assert list(numbers.within(slice(2, 10))) == [2, 5, 9]
    assert (len(FrameNumbers.of([])), list(numbers.within(slice(3, 4)))) == (0, [])
    with pytest.raises(IndexError):
        numbers[6]


@pytest.mark.parametrize(
    ("start", "count", "blocks"),
    [(0, BLOCK_FRAMES, [0]), (0, BLOCK_FRAMES + 1, [0, 1]), (BLOCK_FRAMES - 1, 1, [0]), (BLOCK_FRAMES, 1, [1])],
)
def test_a_whole_block_of_frames_is_one(start, count, blocks):
    numbers = FrameNumbers([range(start, start + count)])
    assert (blocks_of(numbers), numbers.least_blocks(BLOCK_FRAMES)) == (blocks, len(blocks))


# --- verifying ---


def test_a_dataset_is_as_its_recipe_says(made):
    findings = found(made, made.out)
    assert (findings.lines(), findings.as_the_recipe) == ([], True)
    images = sum(1 for _ in made.out.glob("*/*/results/*"))
    assert findings.summary_lines() == [f"30 sequences, {images} images as the recipe says"]


def test_what_is_wrong_is_named(made, copy, capfd):
    damaged, missing = copy / f"{LATE}/depth000004.png", copy / f"{LATE}/frame000002.jpg"
    data = bytearray(damaged.read_bytes())
    data[60] ^= 1
    damaged.unlink()
    damaged.write_bytes(data)
    missing.unlink()
    (copy / "clean/box/traj.txt").write_text("\n")
    (copy / "clean/cam_params.json").unlink()
    (copy / f"{LATE}/frame000099.jpg").write_bytes(b"")
    (copy / "notes.txt").write_text("")
    (copy / "fog_s3/box/frames.jsonl").write_text("")
    shutil.rmtree(copy / "frost_s3/box")
    shutil.copytree(copy / "early", copy / "late2")
    findings = found(made, copy)
    assert findings.lines() == [
        "clean/box: traj.txt: damaged (not as it was written)",
        "fog_s3/box: 9 frames that frames.jsonl should name: missing",
        "fog_s3/box: frames.jsonl: damaged (not as it was written)",
        *[f"fog_s3/box: {line}" for line in [extra(copy / "fog_s3/box")]],
        "late/box: results/frame000002.jpg: missing",
        "late/box: results/depth000004.png: damaged (not as it was written)",
        "late/box: results/frame000099.jpg: extra (neither the recipe nor the dataset's records name it)",
        ".: clean/cam_params.json: missing",
        ".: late2/cam_params.json, notes.txt: extra (neither the recipe nor the dataset's records name it)",
        "frost_s3/box: missing",
        "late2/box: not in the recipe",
    ]
    assert not findings.as_the_recipe
    assert command("verify", made.recipe, copy) == 1
    assert capfd.readouterr().out.splitlines()[:-1] == findings.lines()


def extra(folder):
    names = sorted(path.relative_to(folder).as_posix() for path in folder.glob("results/*"))
    told = ", ".join(names[:4]) + f" and {len(names) - 4} more"
    return f"{told}: extra (neither the recipe nor the dataset's records name it)"


def forge(folder, name, data):
    """Replace a file, and all that the dataset itself says of it."""
    path = folder / name
    before, after = (hashlib.sha256(item).hexdigest() for item in (path.read_bytes(), data))
    path.unlink()
    path.write_bytes(data)
    sequence = "/".join(name.split("/")[:2])
    for text in (folder / sequence / "frames.jsonl", folder / "manifest.json"):
        old = hashlib.sha256(text.read_bytes()).hexdigest()
        text.write_text(text.read_text().replace(before, after))
        new = hashlib.sha256(text.read_bytes()).hexdigest()
        before, after = old, new


def test_a_dataset_that_contradicts_itself_nowhere_is_still_found(made, copy):
    forge(copy, f"{LATE}/depth000004.png", (copy / f"{LATE}/depth000003.png").read_bytes())
    assert found(made, copy).lines() == [
        "late/box: results/depth*.png 0 to 8, frames.jsonl: not as the recipe says",
    ]


def test_another_processor_makes_frames_that_cannot_be_compared(made, copy):
    forge(copy, f"{LATE}/depth000004.png", (copy / f"{LATE}/depth000003.png").read_bytes())
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["identity"]["processor"]["features"] = ["AVX1024"]
    (copy / "manifest.json").write_text(json.dumps(manifest))
    findings = found(made, copy)
    assert (findings.sound, findings.as_the_recipe) == (True, False)
    assert "late/box: results/depth*.png 0 to 8, frames.jsonl: not comparable" in findings.lines()[0]
    assert "with AVX1024: pixels may differ by 1/255" in findings.summary_lines()[0]


def test_an_unfinished_dataset_is_compared_as_far_as_it_goes(made, copy):
    (copy / "manifest.json").unlink()
    findings = found(made, copy)
    assert findings.lines() == [".: manifest.json: missing"]
    refused(found, made, copy / "clean/box/results", names="no dataset")
