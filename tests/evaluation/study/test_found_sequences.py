# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset, or a recording with ground truth, is evaluated where it lies, and not changed."""

import hashlib
import json
import shutil

import pytest
from runs import run
from study_tools import SETTINGS, TIMES, evaluate, rows_of, small_world, write_systems

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("tabulate", reason="tabulate comes with an extra")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("found")
    preset = small_world(folder / "world", settings=[*SETTINGS[:2], SETTINGS[3]], output={"layout": "tum"})
    run(preset, folder / "dataset")
    write_systems(folder / "systems", "fine")
    return folder


def content(folder):
    return {
        path.relative_to(folder).as_posix(): (hashlib.sha256(path.read_bytes()).hexdigest(), path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def columns(rows, *names):
    return [tuple(row[name] for name in names) for row in rows]


def without_times(rows):
    return [{name: value for name, value in row.items() if name not in TIMES} for row in rows]


def test_a_dataset(made, tmp_path):
    before = content(made / "dataset")
    assert (
        evaluate(made / "dataset", "--systems", made / "systems/fine.yaml", "--out", tmp_path / "out", "--jobs", 1) == 0
    )
    assert content(made / "dataset") == before
    rows = rows_of(tmp_path / "out")
    assert columns(rows, "scene", "setting", "perturbation", "mode", "severity", "seed") == [
        ("box", "clean", "clean", "", "", "3"),
        ("box", "fast", "faster_motion", "", "", "3"),
        ("box", "noise", "gaussian_noise", "static", "3", "3"),
    ]
    assert float(rows[0]["ate_rmse_m"]) < 1e-6  # groundtruth.txt is what the path is read from
    clean, _, noise = rows_of(tmp_path / "out", "sequences")
    assert clean["psnr_db_mean"] == ""
    assert 15 < float(noise["psnr_db_mean"]) < 30


def test_its_results_are_those_of_the_preset(made, tmp_path):
    systems = made / "systems/fine.yaml"
    assert evaluate(made / "dataset", "--systems", systems, "--out", tmp_path / "found", "--jobs", 1) == 0
    assert evaluate(made / "world/preset.yaml", "--systems", systems, "--out", tmp_path / "made", "--jobs", 1) == 0
    for kind in ("runs", "sequences"):
        one, other = (without_times(rows_of(tmp_path / name, kind)) for name in ("found", "made"))
        assert one == other


def test_a_part_of_a_dataset(made, tmp_path):
    systems = made / "systems/fine.yaml"
    assert evaluate(made / "dataset", "--systems", systems, "--settings", "n*", "--out", tmp_path, "--jobs", 1) == 0
    assert columns(rows_of(tmp_path), "setting") == [("noise",)]


def test_recordings(made, tmp_path):
    """A folder as TUM has it, of which nothing tells what was done to it."""
    recording = tmp_path / "recordings/desk"
    shutil.copytree(made / "dataset/clean/box", recording)
    shutil.copy(made / "dataset/clean/cam_params.json", tmp_path / "recordings")
    (recording / "frames.jsonl").unlink()
    assert evaluate(recording, "--systems", made / "systems/fine.yaml", "--out", tmp_path / "one", "--jobs", 1) == 0
    (row,) = rows_of(tmp_path / "one")
    assert columns([row], "scene", "setting", "perturbation", "seed") == [("desk", "recorded", "clean", "0")]
    assert float(row["ate_rmse_m"]) < 1e-6
    shutil.copytree(recording, tmp_path / "recordings/room")
    systems = made / "systems/fine.yaml"
    assert evaluate(tmp_path / "recordings", "--systems", systems, "--out", tmp_path / "two", "--jobs", 1) == 0
    assert columns(rows_of(tmp_path / "two"), "scene") == [("desk",), ("room",)]


def test_another_folder_is_another_study(made, tmp_path, capfd):
    systems = made / "systems/fine.yaml"
    other = tmp_path / "other"
    shutil.copytree(made / "dataset", other)
    poses = other / "noise/box/groundtruth.txt"
    poses.write_text(poses.read_text().replace("\n0.05 ", "\n0.05 9", 1))
    assert evaluate(made / "dataset", "--systems", systems, "--out", tmp_path / "out", "--jobs", 1) == 0
    capfd.readouterr()
    assert evaluate(other, "--systems", systems, "--out", tmp_path / "out", "--jobs", 1) == 1
    assert "found.box/noise/seed-3.sha256" in capfd.readouterr().err


def test_what_goes_with_a_preset_alone_is_refused(made, tmp_path, capfd):
    for words in (["--set", "seed=2"], ["--seeds", "1"], ["--keep"], ["--data", tmp_path]):
        assert (
            evaluate(made / "dataset", "--systems", made / "systems/fine.yaml", "--out", tmp_path / "out", *words) == 1
        )
        assert f"and {words[0]} goes with a preset" in capfd.readouterr().err
    (tmp_path / "empty").mkdir()
    assert evaluate(tmp_path / "empty", "--systems", made / "systems/fine.yaml", "--out", tmp_path / "out") == 1
    assert "holds no sequence" in capfd.readouterr().err
    assert json.loads((made / "dataset/manifest.json").read_text())
