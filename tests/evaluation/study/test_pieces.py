# SPDX-License-Identifier: GPL-3.0-or-later
"""A study in pieces: put together they are the study that was run at once, and what is no piece of it is refused."""

import csv
import json
import shutil

import pytest
from results_made import without_analyses, without_pictures
from study_tools import TIMES, evaluate, rows_of, small_world, write_systems

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("tabulate", reason="tabulate comes with an extra")
pytest.importorskip("jinja2", reason="the extra evaluate is not installed")

from noisy_world.cli import command

SETTINGS = [{"name": "clean"}, {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}]}]


def put_together(*words):
    return command.main(["report", "--tables", *map(str, words)])


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A study that was run at once, and one whose pieces differ in settings and systems."""
    folder = tmp_path_factory.mktemp("pieces")
    preset = small_world(folder / "world", settings=SETTINGS)
    systems = write_systems(folder / "systems", "half", "crash").split(",")
    both = ",".join(systems)
    run = (preset, "--jobs", 1)
    assert evaluate(*run, "--systems", both, "--out", folder / "whole") == 0
    assert evaluate(*run, "--systems", both, "--settings", "clean", "--out", folder / "clean") == 0
    assert evaluate(*run, "--systems", systems[0], "--settings", "noise", "--out", folder / "noise") == 0
    return folder, run, both


def same_tables(left, right):
    """Whether two folders have the same tables, but for the times that runs took."""
    read = [
        [{key: value for key, value in row.items() if key not in TIMES} for row in rows_of(folder, name)]
        for folder in (left, right)
        for name in ("runs", "sequences")
    ]
    return read[:2] == read[2:]


def test_the_pieces_and_the_rest_of_them_are_the_whole(study, tmp_path, capfd):
    folder, run, both = study
    assert put_together(folder / "clean", folder / "noise", "--out", tmp_path / "record") == 0
    assert "3 runs on 2 sequences, of 2 pieces" in capfd.readouterr().out
    assert evaluate(*run, "--systems", both, "--rest-of", tmp_path / "record", "--out", tmp_path / "rest") == 0
    done = {(row["setting"], row["system"], row["repeat"]) for row in rows_of(tmp_path / "rest")}
    assert done == {("noise", "crash", "1")}
    # A record grows in its own folder; the order of pieces counts no more than a piece that is named twice.
    pieces = (tmp_path / "rest", tmp_path / "record", folder / "clean")
    assert put_together(*pieces, "--out", tmp_path / "record") == 0
    assert same_tables(tmp_path / "record", folder / "whole")
    assert sorted(path.name for path in (tmp_path / "record").rglob("*") if path.is_file()) == [
        *("runs.csv", "sequences.csv", "study.json")
    ]
    assert put_together(folder / "whole", "--out", tmp_path / "whole") == 0
    texts = [(tmp_path / name / "study.json").read_bytes() for name in ("record", "whole")]
    assert texts[0] == texts[1]
    for name in ("runs", "sequences"):  # the record of one folder has its tables to the byte
        table = f"tables/{name}.csv"
        assert (tmp_path / "whole" / table).read_bytes() == (folder / "whole" / table).read_bytes()
    capfd.readouterr()
    assert evaluate(*run, "--systems", both, "--rest-of", tmp_path / "record", "--out", tmp_path / "none") == 0
    assert "nothing is left to do" in capfd.readouterr().out
    assert not (tmp_path / "none").exists()


def test_a_report_is_written_of_a_record(study, tmp_path, capfd, monkeypatch):
    folder, _, _ = study
    without_analyses(monkeypatch)  # which have nothing to say here
    without_pictures(monkeypatch)
    assert put_together(folder / "clean", folder / "noise", "--out", tmp_path / "all") == 0
    before = (tmp_path / "all/tables/runs.csv").read_bytes()
    assert len(before.splitlines()) == 4
    assert command.main(["report", str(tmp_path / "all")]) == 0
    said = capfd.readouterr().out
    assert "crash has no run on 1 of 2 sequences: box/noise/seed-3." in said
    assert said.count("missing: ") == 2
    assert "this is a record: paths, errors over time and frames are in the folders of its pieces" in said
    assert (tmp_path / "all/tables/runs.csv").read_bytes() == before  # not made anew from runs that are not there


def changed(folder, to, name, change):
    """A copy of a record whose study.json or runs.csv is another."""
    shutil.copytree(folder, to)
    path = to / name
    if path.suffix == ".json":
        content = json.loads(path.read_text())
        change(content["study"])
        path.write_text(json.dumps(content))
    else:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        change(rows[0])
        with path.open("w", newline="") as file:
            table = csv.DictWriter(file, rows[0])
            table.writeheader()
            table.writerows(rows)
    return to


def known(study):
    study["versions"]["half"]["half"] = "1.0"
    study["subject"]["processor"]["machine"] = "x86_64"


CHANGES = {
    "camera": ("study.json", lambda study: study["subject"]["scenes"]["box"]["camera"].update(fx=99.0)),
    "definition": ("study.json", lambda study: study["systems"]["half"].update(digest="0" * 64)),
    "version": ("study.json", lambda study: study["versions"]["half"].update(half="2.0")),
    "value": ("tables/runs.csv", lambda row: row.update(tracked_share="0.25")),
    "processor": ("study.json", lambda study: study["subject"]["processor"].update(machine="abacus")),
}


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("camera", "is no piece of the study that the first one is of: scenes.box.camera"),
        ("definition", "the definition of half is another"),
        ("version", "half ran with half 1.0 there, and with 2.0 here"),
        ("value", "box/clean/seed-3/crash/repeat-1 is in both with another tracked_share"),
        ("processor", "processor.machine was x86_64, is abacus"),
    ],
)
def test_what_is_no_piece_is_refused(study, tmp_path, capfd, what, said):
    folder, _, _ = study
    assert put_together(folder / "clean", "--out", tmp_path / "record") == 0
    first = changed(tmp_path / "record", tmp_path / "first", "study.json", known)
    other = changed(first, tmp_path / "other", *CHANGES[what])
    assert put_together(first, other, "--out", tmp_path / "all") == 1
    error = capfd.readouterr().err.splitlines()[-1]
    assert str(other) in error
    assert said in error
    assert not (tmp_path / "all").exists()


def test_processors_of_any_kind_are_taken_where_the_preset_says_so(study, tmp_path):
    folder, _, _ = study
    assert put_together(folder / "clean", "--out", tmp_path / "record") == 0

    def any_processor(study):
        study["subject"]["preset"]["render"]["processors"] = "any"

    def elsewhere(study):
        any_processor(study)
        study["subject"]["processor"]["machine"] = "abacus"
        study["processors"][0]["machine"] = "abacus"

    pieces = [
        changed(tmp_path / "record", tmp_path / name, "study.json", change)
        for name, change in (("here", any_processor), ("there", elsewhere))
    ]
    assert put_together(*pieces, "--out", tmp_path / "all") == 0
    study = json.loads((tmp_path / "all/study.json").read_text())["study"]
    assert [kind["machine"] == "abacus" for kind in study["processors"]] == [False, True]


def test_bad_folders_are_one_line_each(study, tmp_path, capfd):
    folder, run, both = study
    (tmp_path / "empty").mkdir()
    assert put_together(tmp_path / "empty", "--out", tmp_path / "all") == 1
    assert "holds no study; a folder that 'noisy-world evaluate' wrote is needed" in capfd.readouterr().err
    assert put_together(folder / "clean", "--out", folder / "whole") == 1
    assert "whole is not empty and holds no record; name another with --out" in capfd.readouterr().err.replace(":", "")
    with pytest.raises(SystemExit):
        put_together(folder / "clean", folder / "noise")
    assert "name it with --out" in capfd.readouterr().err
    assert put_together(folder / "clean", "--out", tmp_path / "record") == 0
    assert evaluate(*run, "--systems", both, "--out", tmp_path / "record") == 1
    assert "is the record of a study, without its runs; choose another folder" in capfd.readouterr().err
    runs = tmp_path / "record/tables/runs.csv"
    runs.write_text(runs.read_text() + "cut\n")
    assert put_together(tmp_path / "record", "--out", tmp_path / "all") == 1
    assert "runs.csv: cannot be read: " in capfd.readouterr().err
    other = small_world(tmp_path / "world", settings=SETTINGS, size=(16, 12))
    command_of_other = (other, "--systems", both, "--rest-of", folder / "clean", "--out", tmp_path / "rest")
    assert evaluate(*command_of_other) == 1
    assert "is of another study: " in capfd.readouterr().err
    assert not (tmp_path / "rest").exists()
