# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world evaluate` from preset to tables: what systems do is a result, and what is there stays."""

import json
import shutil
import sys
from functools import partial

import pytest
from results_made import without_analyses, without_pictures
from study_tools import FRAMES, SETTINGS, evaluate, rows_of, small_world, told, write_systems

from noisy_world.core import packages
from noisy_world.evaluate import study

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("tabulate", reason="tabulate comes with an extra")

KINDS = ("fine", "half", "crash", "hang", "nan", "still", "three", "nothing")


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A study of all kinds of systems."""
    folder = tmp_path_factory.mktemp("study")
    preset = small_world(folder / "world", settings=SETTINGS[:2])
    systems = write_systems(folder / "systems", *KINDS)
    with pytest.MonkeyPatch.context() as patch:
        without_analyses(patch)
        without_pictures(patch)
        assert evaluate(preset, "--systems", systems, "--out", folder / "results", "--jobs", 1, report=True) == 0
    return folder


def test_each_run_is_a_row_and_each_end_a_result(done):
    rows = {row["system"]: row for row in rows_of(done / "results") if row["setting"] == "clean"}
    assert set(rows) == set(KINDS)
    ends = {name: (row["outcome"], row["failure"]) for name, row in rows.items()}
    assert ends == {
        "fine": ("finished", ""),
        "half": ("finished", ""),
        "crash": ("crashed", "no_poses"),
        "hang": ("timed_out", "no_poses"),
        "nan": ("not_finite", "no_poses"),
        "still": ("finished", "stands_still"),
        "three": ("finished", ""),
        "nothing": ("no_estimate", "no_poses"),
    }
    assert float(rows["fine"]["ate_rmse_m"]) < 1e-9
    assert float(rows["fine"]["tracked_share"]) == 1.0
    assert float(rows["half"]["tracked_share"]) == 0.5
    assert rows["crash"]["ate_rmse_m"] == ""
    assert (rows["crash"]["paper.ate_m"], rows["crash"]["paper.sr"]) == ("1.0", "0.0")
    assert {row["frames"] for row in rows.values()} == {str(FRAMES)}
    assert {(row["perturbation"], row["mode"], row["severity"], row["seed"]) for row in rows.values()} == {
        ("clean", "", "", "3")
    }


def test_what_stays_of_a_sequence(done):
    (noise,) = (row for row in rows_of(done / "results", "sequences") if row["setting"] == "noise")
    assert (noise["perturbation"], noise["mode"], noise["severity"], noise["frames"]) == (
        "gaussian_noise",
        "static",
        "3",
        "6",
    )
    assert 15 < float(noise["psnr_db_mean"]) < 30
    folder = done / "results/sequences/box/noise/seed-3"
    assert len((folder / "truth.txt").read_text().splitlines()) == FRAMES
    assert len((folder / "frames.csv").read_text().splitlines()) == 1 + FRAMES
    assert list((folder / "thumbs").glob("*.jpg"))
    assert not (done / "results/.noisy_world").exists()
    assert not (done / "results/kept").exists()


def test_what_is_missing_is_said_before_anything_is_done(tmp_path, monkeypatch, capfd):
    preset = small_world(tmp_path / "world", settings=SETTINGS[:1])
    command = (preset, "--systems", write_systems(tmp_path / "systems", "fine"), "--out", tmp_path / "results")
    for dry in ([], ["--dry-run"]):
        with monkeypatch.context() as patched:
            patched.setitem(sys.modules, "embreex.rtcore_scene", None)  # importing it raises ImportError
            assert evaluate(*command, *dry) == 1
        assert "run: " + packages.install_command("embree") in capfd.readouterr().err
        with monkeypatch.context() as patched:
            patched.setattr(packages, "missing_packages", {"pandas"}.intersection)
            assert evaluate(*command, *dry, report=True) == 1
        said = capfd.readouterr()
        assert said.err.startswith("noisy-world evaluate: pandas: missing in this Python")
        assert said.err.endswith(f"; run: {packages.install_command('evaluate')}\n")
        assert ("missing    1 of 1 run," in said.out) == bool(dry)
    assert evaluate(*command, "--dry-run", report=True) == 0
    assert not (tmp_path / "results").exists()


def test_it_ends_with_a_report(done):
    page = (done / "results/report.html").read_text()
    assert all(f"system {kind}" in page for kind in KINDS)
    assert (done / "results/tables/settings.csv").is_file()


def test_the_same_command_again_runs_nothing(done, monkeypatch):
    before = told(done / "results")
    monkeypatch.setattr("noisy_world.evaluate.study.run_system", None)
    words = (done / "world/preset.yaml", "--systems", ",".join(str(done / f"systems/{kind}.yaml") for kind in KINDS))
    assert evaluate(*words, "--out", done / "results") == 0
    assert told(done / "results") == before


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--set", "seed=4"], "holds another study: seed was 3, is 4"),
        (["--set", "camera.fx=20"], "holds another study: scenes.box.camera.fx was 16, is 20"),
        (["--set", "settings.1.perturb.0.gaussian_noise.severity=5"], "settings.noise.steps.0.parameters"),
        (["--protocol", "paper"], "protocol was strict, is paper"),
    ],
)
def test_another_study_is_refused_with_the_first_difference(done, capfd, words, problem):
    preset, systems = done / "world/preset.yaml", done / "systems/fine.yaml"
    before = told(done / "results")
    assert evaluate(preset, "--systems", systems, "--out", done / "results", *words) == 1
    (line,) = capfd.readouterr().err.splitlines()
    assert problem in line
    assert "--out" in line
    assert told(done / "results") == before


def test_a_changed_system_is_refused(done, capfd):
    changed = done / "changed"
    shutil.copytree(done / "systems", changed)
    (changed / "fine.yaml").write_text((changed / "fine.yaml").read_text() + "threads: 1\n")
    preset = done / "world/preset.yaml"
    assert evaluate(preset, "--systems", changed / "fine.yaml", "--out", done / "results") == 1
    assert "the definition of fine is another" in capfd.readouterr().err


def test_a_folder_with_something_else_is_refused(done, tmp_path, capfd):
    (tmp_path / "thesis.tex").write_text("")
    preset, systems = done / "world/preset.yaml", done / "systems/fine.yaml"
    assert evaluate(preset, "--systems", systems, "--out", tmp_path) == 1
    assert "is not empty and holds no study" in capfd.readouterr().err


def test_a_study_grows(tmp_path):
    preset = small_world(tmp_path / "world")
    systems = write_systems(tmp_path / "systems", "fine", "half")
    first, both = systems.split(",")[0], systems
    assert (
        evaluate(preset, "--systems", first, "--settings", "clean,noise", "--out", tmp_path / "grown", "--jobs", 1) == 0
    )
    assert evaluate(preset, "--systems", both, "--seeds", "3,8", "--out", tmp_path / "grown", "--jobs", 1) == 0
    assert evaluate(preset, "--systems", both, "--seeds", "3,8", "--out", tmp_path / "whole", "--jobs", 1) == 0
    grown, whole = told(tmp_path / "grown"), told(tmp_path / "whole")
    assert [name for name in whole if grown[name] != whole[name]] == []
    # Pictures of frames that a run lost are beside the others in both, whichever run was the first.
    assert set(grown) == set(whole)
    seeds = {(row["setting"], row["seed"]) for row in rows_of(tmp_path / "whole")}
    assert seeds == {("clean", "3"), ("noise", "3"), ("noise", "8"), ("bright", "3"), ("fast", "3")}


def test_systems_that_do_not_repeat_themselves_are_repeated(tmp_path):
    preset = small_world(tmp_path / "world", settings=SETTINGS[:1])
    systems = write_systems(tmp_path / "systems", "half", repeatable=False)
    assert evaluate(preset, "--systems", systems, "--out", tmp_path / "out", "--repeats", 3, "--jobs", 1) == 0
    assert [row["repeat"] for row in rows_of(tmp_path / "out")] == ["1", "2", "3"]
    assert json.loads((tmp_path / "out/study.json").read_text())["study"]["repeats"] == 3


def test_what_is_wrong_is_a_line(tmp_path, capfd):
    preset = small_world(tmp_path / "world")
    assert evaluate(preset, "--systems", "nobodys_slam", "--out", tmp_path / "out") == 1
    assert "nobodys_slam" in capfd.readouterr().err
    two = ",".join(write_systems(tmp_path / name, "fine", frames=2 + len(name)) for name in ("a", "bc"))
    assert evaluate(preset, "--systems", two, "--out", tmp_path / "out") == 1
    assert "bc/fine.yaml: name: is a second system called fine; rename one" in capfd.readouterr().err
    assert evaluate(tmp_path / "none.yaml", "--systems", "fine", "--out", tmp_path / "out") == 1
    assert "no such preset" in capfd.readouterr().err
    for words in (["--seeds", "1,two"], ["--repeats", "0"], []):
        with pytest.raises(SystemExit):
            evaluate(preset, *words)
    assert not (tmp_path / "out").exists()


def test_maps(tmp_path, monkeypatch):
    """Frames without noise, fused along the true path, lie on the room's walls; a system's own map is held as it is."""
    few = partial(study.true_map_of_mesh, samples=20_000)  # points, of 200,000
    monkeypatch.setattr(study, "true_map_of_mesh", few)
    preset = small_world(tmp_path / "world", size=(64, 48), settings=SETTINGS[:1])
    systems = write_systems(tmp_path / "systems", "fine", "crash", "disc")
    out = tmp_path / "out"
    assert evaluate(preset, "--systems", systems, "--out", out, "--jobs", 1, "--maps") == 0
    fine, disc, crash = sorted(rows_of(out), key=lambda row: row["system"], reverse=True)
    assert (disc["outcome"], disc["map.accuracy_m"], disc["map.f_score_5cm"]) == ("finished", "", "0.0")
    assert float(fine["map.accuracy_m"]) < 0.01
    assert float(fine["map.completion_ratio_5cm"]) > 0.9
    assert crash["map.accuracy_m"] == ""
    assert float(crash["map.completion_ratio_5cm"]) == 0.0
    assert evaluate(preset, "--systems", systems, "--out", out) == 1  # a study without maps is another
