# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset's folder that somebody or something changed: remade or refused in a line, and nothing else is touched."""

import hashlib
import json
import os
import re
import shutil
import sys

import pytest
from refusals import refused
from cases import cases
from growing import CLEAN, FOG, change, marks, stopped, world
from worlds import content
from runs import run

from noisy_world.layouts import LAYOUTS
from noisy_world.core.errors import StorageError
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.folder_state import check_place
from noisy_world.dataset.dataset_status import read_status
from noisy_world.dataset.recipe import recipe_of
from noisy_world.dataset.stored import finished_folder

pytestmark = pytest.mark.usefixtures("no_blender")


@pytest.fixture
def finished(tmp_path):
    preset = world(tmp_path / "world", settings=[CLEAN, FOG])
    run(preset, tmp_path / "out")
    return preset, tmp_path / "out"


@pytest.fixture
def unfinished(tmp_path):
    preset = world(tmp_path / "world", settings=[CLEAN, FOG])
    stopped(preset, tmp_path / "out", 4)
    return preset, tmp_path / "out"


def whole(preset, tmp_path):
    run(preset, tmp_path / "whole")
    return content(tmp_path / "whole")


def left_alone(preset, out, *names, **options):
    refused(run, preset, out, names=[str(out), *names], error=StorageError, **options)


@pytest.mark.parametrize(
    "name", ["../../../outside/kept.txt", "results/../../../../outside/kept.txt", "/outside/kept.txt"]
)
def test_a_journal_leads_nowhere_else(unfinished, tmp_path, name):
    preset, out = unfinished
    kept = tmp_path / "outside/kept.txt"
    kept.parent.mkdir()
    kept.write_text("somebody's")
    name = name.replace("/outside", str(kept.parent)) if name.startswith("/") else name
    digest = hashlib.sha256(kept.read_bytes()).hexdigest()
    # A frame with this one file is incomplete, and files of incomplete frames are removed.
    for frame in (0, 5, 77, -1):
        record = {"sequence": "clean/box", "frame": frame, "time_s": max(frame, 0) / 20, "sha256": {name: digest}}
        with (out / ".noisy_world/journal-0.box.jsonl").open("a") as journal:
            journal.write(json.dumps(record) + "\n")
    run(preset, out, frames=slice(0, 4))
    assert kept.read_text() == "somebody's"
    run(preset, out)
    assert content(out) == whole(preset, tmp_path)
    assert kept.read_text() == "somebody's"


@cases(
    "sequences", [["../outside"], {"../outside": 6}, ["clean/.."], "../outside", {"clean/box/x": 6}, [["clean/box"]]]
)
def test_an_identity_leads_nowhere_else(finished, tmp_path, sequences):
    preset, out = finished
    other = tmp_path / "outside/results/frame000000.png"
    other.parent.mkdir(parents=True, exist_ok=True)
    other.write_bytes(b"another's frame")
    manifest = out / "manifest.json"
    text = manifest.read_text()
    document = json.loads(text)
    document["identity"]["sequences"] = sequences
    manifest.write_text(json.dumps(document))
    left_alone(preset, out, "manifest.json", "--overwrite")
    run(preset, out, overwrite=True)
    assert other.read_bytes() == b"another's frame"
    assert manifest.read_text() == text


def test_a_link_in_place_of_the_working_folder_is_not_followed(finished, tmp_path):
    preset, out = finished
    papers = tmp_path / "papers"
    (papers / "unfinished").mkdir(parents=True)
    (papers / "unfinished/thesis.tex").write_text("years")
    (out / ".noisy_world").symlink_to(papers)
    for overwrite in (False, True):
        left_alone(preset, out, ".noisy_world: ", "a run works in", "remove it", overwrite=overwrite)
    assert (papers / "unfinished/thesis.tex").read_text() == "years"


@pytest.mark.parametrize("place", ["fog", "fog/box", "fog/box/results"])
def test_links_in_place_of_folders_are_not_followed(finished, tmp_path, place):
    preset, out = finished
    shutil.move(out / place, tmp_path / "elsewhere")
    (out / place).symlink_to(tmp_path / "elsewhere")
    before = marks(tmp_path)
    for overwrite in (False, True):
        left_alone(preset, out, f"{place}: ", "link", "remove it", overwrite=overwrite)
        there = {name: mark for name, mark in marks(tmp_path).items() if name.startswith("elsewhere")}
        assert there == {name: mark for name, mark in before.items() if name.startswith("elsewhere")}
    (out / place).unlink()
    run(preset, out)
    assert content(out) == whole(preset, tmp_path)


def test_nothing_is_written_or_believed_through_a_link(tmp_path):
    """Every file and folder of a dataset in each layout, one after another, is a link to what it was."""
    for layout in LAYOUTS:
        preset = world(tmp_path / layout, settings=[CLEAN], output={"layout": layout})
        out, theirs = tmp_path / f"out_{layout}", tmp_path / f"theirs_{layout}"
        run(preset, out)
        names = [path.relative_to(out) for path in out.rglob("*") if not re.search("[1-9][^/]*[.]png$", path.name)]
        assert len(names) > 8
        for name in names:
            (out / name).rename(theirs)
            (out / name).symlink_to(theirs)
            before = marks(tmp_path) | {"theirs": theirs.stat().st_mtime_ns}
            left_alone(preset, out, str(name), "link")
            if name.name != "manifest.json":
                for act in (
                    finished_folder,
                    lambda out: recipe_of(out, PlainProgress(sys.stderr)),
                    lambda out: read_status(out, PlainProgress(sys.stderr)),
                ):
                    refused(act, out, names=[f"{name}: ", "link"], error=StorageError)
            assert marks(tmp_path) | {"theirs": theirs.stat().st_mtime_ns} == before
            (out / name).unlink()
            theirs.rename(out / name)
        (out / "clean/box/mine.txt").symlink_to(preset)  # what is not the dataset's may be a link
        out.rename(theirs)
        out.symlink_to(theirs)  # and so may the dataset's folder
        assert run(preset, out).frames_rendered == 0


@pytest.mark.parametrize(
    ("place", "words"), [("a", "is a file, not a folder"), ("a/b/c", "no folder can be made in it")]
)
def test_a_file_in_the_way_of_a_folder_is_named(tmp_path, place, words):
    (tmp_path / "a").write_text("mine")
    said = refused(check_place, tmp_path / place, names=words, error=StorageError)
    assert said.startswith(f"{tmp_path / 'a'}: ")


def test_a_manifest_of_something_else_is_left_alone(finished, tmp_path):
    preset, _ = finished
    site = tmp_path / "site"
    site.mkdir()
    for text in ('{"name": "a web page", "icons": []}', '{"identity": {"format": 2, "sequences": 3}}', "[]"):
        (site / "manifest.json").write_text(text)
        for overwrite in (False, True):
            left_alone(preset, site, "not empty", overwrite=overwrite)
        assert (site / "manifest.json").read_text() == text


def folder(path):
    path.mkdir()


def dangling(path):
    path.symlink_to("nowhere")


def loop(path):
    path.symlink_to(path.name)


def pipe(path):
    os.mkfifo(path)


def elsewhere(path):
    """A link to a copy, as data managers leave it."""
    path.symlink_to(path.with_name(f"{path.name}.kept"))


@cases("replacement", [folder, dangling, loop, elsewhere, pipe])
def test_what_is_no_file_is_said(finished, tmp_path, replacement):
    preset, out = finished
    expected = whole(preset, tmp_path)
    for name in ("manifest.json", "clean/box/frames.jsonl", "clean/box/traj.txt", "fog/box/results/depth000002.png"):
        kept = (out / name).rename(out / f"{name}.kept")
        replacement(out / name)
        if replacement is not pipe or name == "manifest.json":
            left_alone(preset, out, name, "link" * (out / name).is_symlink())
        else:
            run(preset, out)
        assert kept.exists()
        kept.unlink()
        if replacement is folder:
            assert (out / name).is_dir()
            (out / name).rmdir()
        run(preset, out, overwrite=True)
        assert content(out) == expected


@cases(
    "text, words",
    [
        ("", "line 1, column 1"),
        ('{"identity": NaN}', "NaN"),
        ("[" * 100_000, "nested"),
        ('{"identity": ' + "[" * 500 + "]" * 500 + "}", "nested"),
        ('{"identity": 1e999}', "1e999"),
        ('{"identity": ' + "9" * 5000 + "}", "5000 digits"),
        ('{"identity": "\\ud800"}', "UTF-8"),
        (b"\xff\xfe{}", "UTF-8"),
        ("null", "identity"),
        ('{"identity": {"format": true, "sequences": {}}}', "identity"),
        ('{"identity": {"format": 2, "sequences": {}}}', "lacks"),
        ('{"identity": {"format": 3, "sequences": []}}', "later version"),
    ],
)  # fmt: skip
def test_a_manifest_that_nobody_wrote_is_refused(finished, text, words):
    preset, out = finished
    before = marks(out)
    manifest = out / "manifest.json"
    kept = manifest.read_bytes()
    manifest.write_bytes(text if isinstance(text, bytes) else text.encode())
    file = "" if words == "later version" else "manifest.json"  # the whole dataset is later, not a file of it
    left_alone(preset, out, file, words, "--out")
    assert marks(out) == before
    manifest.write_bytes(kept)
    run(preset, out)
    assert marks(out) == before


@cases(
    "change",
    [
        {"frame": 10**400}, {"frame": True}, {"frame": "0"}, {"frame": -1}, {"frame": 1.5}, {"frame": None},
        {"time_s": 10**400}, {"time_s": True}, {"time_s": None}, {"time_s": 0.3}, {"sha256": []},
        {"sha256": {"results/frame000000.png": 3}}, {"depth_time_s": 7.0}, {"perturbed": []}, {"perturbed": "x"},
    ],
)  # fmt: skip
def test_records_that_nobody_wrote_are_no_records(finished, tmp_path, change):
    preset, out = finished
    path = out / "clean/box/frames.jsonl"
    good = path.read_text()
    first, *rest = good.splitlines(keepends=True)
    path.write_text(json.dumps(json.loads(first) | change) + "\n" + "".join(rest))
    report = run(preset, out)
    assert report.frames_rendered == 6  # what else was changed in the file nobody can tell
    assert report.notes == [CHANGED]
    assert path.read_text() == good


CHANGED = "clean/box/frames.jsonl is not as it was written; its frames are made again"


def test_changed_records_are_not_believed_though_they_could_be(finished, tmp_path):
    preset, out = finished
    expected = whole(preset, tmp_path)
    edits = (
        (FOG["name"], '"severity": 3', '"severity": 5'),
        (FOG["name"], '"name": "fog"', '"name": "frost"'),
        (FOG["name"], '"perturbed"', '"was"'),
        ("clean", "}}\n", '}, "depth_out_of_range": {"pixels": 3, "farthest_m": 70.5, "beyond": "void"}}\n'),
    )
    for setting, old, new in edits:
        path = out / setting / "box/frames.jsonl"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))
        report = run(preset, out)
        assert report.notes == [CHANGED.replace("clean", setting)]
        assert content(out) == expected
    # An image that was changed, with its hash.
    image, path = out / "clean/box/results/frame000002.png", out / "clean/box/frames.jsonl"
    old, new = (hashlib.sha256((out / f"clean/box/results/frame00000{n}.png").read_bytes()).hexdigest() for n in (2, 3))
    image.unlink()
    shutil.copy(out / "clean/box/results/frame000003.png", image)
    path.write_text(path.read_text().replace(old, new))
    assert run(preset, out).notes == [CHANGED]
    assert content(out) == expected


def test_a_journal_that_says_what_is_not_planned_is_not_believed(unfinished, tmp_path):
    preset, out = unfinished
    path = out / ".noisy_world/journal-0.box.jsonl"
    text = path.read_text()
    assert '"severity": 3' in text
    path.write_text(text.replace('"severity": 3', '"severity": 5', 1))
    report = run(preset, out)
    (note,) = report.notes
    assert re.match("fog/box: 1 records of its journals, of frame . the first, do not say what is planned; what", note)
    assert report.frames_rendered == 3
    assert content(out) == whole(preset, tmp_path)


def test_without_its_identity_a_run_is_not_taken_up(unfinished, tmp_path):
    preset, out = unfinished
    (out / ".noisy_world/identity.json").write_text("{")
    left_alone(preset, out, "identity.json", "line 1, column 2")
    run(preset, out, overwrite=True)
    assert content(out) == whole(preset, tmp_path)


def test_without_the_identity_of_a_run_that_adds_the_finished_part_stays(finished, tmp_path):
    preset, out = finished
    before = marks(out)
    change(preset, {"settings": [CLEAN, FOG, {"name": "dim", "perturb": [{"brightness": None}]}]})
    stopped(preset, out, 4)
    (out / ".noisy_world/identity.json").write_text("{")
    report = run(preset, out)
    assert "frames that only it describes are made again" in report.notes[0]
    assert report.frames_rendered == 6
    assert {name: marks(out)[name] for name in before} == before
    assert content(out) == whole(preset, tmp_path)
