# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world threshold` from preset to figure, with a system that bears a delay of three frames."""

import csv
import json
import signal
import sys

import pytest
import yaml
from study_tools import small_world, write_systems

from noisy_world.cli import command

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("matplotlib", reason="matplotlib comes with the extra evaluate")

# Knows the way, unless depth is that of more than three frames later: so many more of the last images are one.
PROGRAM = """
import json, sys
frames, out, path = sys.argv[1:4]
index = json.load(open(frames))["frames"]
depth = [open(frame["depth"], "rb").read() for frame in index]
late = next(k for k in range(len(depth)) if depth[-2 - k] != depth[-1])
if late > 3:
    sys.exit(1)
rows = open(path).read().splitlines()
with open(out + "/poses.txt", "w") as file:
    file.writelines(f"{frame['stamp_s']!r} {rows[frame['index']]}\\n" for frame in index)
"""
FRAMES = 12
SEARCH = ("--perturbation", "desync", "--from", "1", "--to", "11")


def threshold(*words):
    """Run the command in this process and return its status."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        return command.main(["threshold", *map(str, words)])
    except SystemExit as usage:
        return usage.code
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A preset of two scenes on one mesh, and the system."""
    folder = tmp_path_factory.mktemp("threshold")
    scenes = [{"name": name, "mesh": "mesh.ply", "trajectory": "traj.txt"} for name in ("one", "two")]
    small_world(folder, frames=FRAMES, size=(32, 24), scenes=scenes, settings=[{"name": "clean"}])
    write_systems(folder, "fine", frames=FRAMES)
    definition = yaml.safe_load((folder / "fine.yaml").read_text())
    (folder / "patient.py").write_text(PROGRAM)
    words = [sys.executable, "-I", "-S", "{here}/patient.py", "{frames}", "{out}", str(folder / "way.txt")]
    (folder / "patient.yaml").write_text(yaml.safe_dump({**definition, "name": "patient", "command": words}))
    return folder


def search(world, out, *more, system="patient"):
    return threshold(world / "preset.yaml", "--system", world / f"{system}.yaml", *SEARCH, "--out", out, *more)


def test_a_threshold_is_found_and_a_search_goes_on(world, tmp_path, capfd):
    file = tmp_path / "whole/desync.offset/patient.threshold.json"
    assert search(world, tmp_path / "whole") == 0
    (said,) = (line for line in capfd.readouterr().out.splitlines() if line.startswith("patient"))
    assert "patient, desync.offset: the threshold is " in said
    assert " frames (95 %: " in said
    content = json.loads(file.read_text())
    assert 3 < content["found"]["threshold"] < 4.2
    assert {trial["succeeded"] for trial in content["trials"] if trial["value"] <= 3} == {True}
    assert {trial["succeeded"] for trial in content["trials"] if trial["value"] > 3} == {False}
    assert {trial["outcome"] for trial in content["trials"]} == {"finished", "crashed"}
    (row,) = csv.DictReader((tmp_path / "whole/thresholds.csv").open(newline=""))
    assert (row["system"], row["parameter"], row["unit"], row["verdict"]) == ("patient", "offset", "frames", "found")
    assert float(row["mild_end"]) < float(row["threshold"]) < float(row["worst_end"])
    assert b"<svg" in (tmp_path / "whole/thresholds.svg").read_bytes()

    out = tmp_path / "halves"  # ended after four runs, as by --most, and taken up again
    assert search(world, out, "--most", 4) == 0
    assert "wider than asked for" in capfd.readouterr().out
    assert search(world, out) == 0
    assert (out / "desync.offset/patient.threshold.json").read_bytes() == file.read_bytes()
    for name in ("thresholds.csv", "thresholds.svg"):
        assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_without_a_limit_the_bound_is_said(world, tmp_path, capfd):
    assert search(world, tmp_path, system="fine") == 0
    said = capfd.readouterr().out
    assert "fine, desync.offset: more than half succeed at the worst value too, 11 frames; no threshold" in said
    (row,) = csv.DictReader((tmp_path / "thresholds.csv").open(newline=""))
    assert (row["verdict"], row["threshold"], row["worst_end"]) == ("holds", "", "")


def test_another_search_goes_into_another_folder(world, tmp_path, capfd):
    assert search(world, tmp_path, "--most", 1) == 0
    assert search(world, tmp_path, "--most", 1, "--set", "seed=9") == 1
    said = capfd.readouterr().err
    assert "patient.threshold.json: holds another search: " in said
    assert "choose another folder with --out" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--perturbation", "fogg"), "--perturbation: unknown perturbation 'fogg'"),
        (
            ("--perturbation", "fog_depth", "--success", "ate_rmse_m"),
            "--success: unknown metric of success 'ate_rmse_m'",
        ),
        ((*SEARCH, "--with", "offset=3"), "--with offset=3: offset is what is searched; leave it out"),
        ((*SEARCH, "--with", "mode"), "--with mode: has to be KEY=VALUE"),
        ((*SEARCH, "--with", "modus=static"), "unknown key 'modus'"),
        ((*SEARCH, "--width", "2"), "'2' has to be a number between 0 and 1"),
        (("--perturbation", "motion_deviation"), "motion_deviation has no severity; name one of"),
    ],
)
def test_bad_input_is_one_line(world, tmp_path, capfd, words, message):
    status = threshold(world / "preset.yaml", "--system", world / "fine.yaml", "--out", tmp_path / "out", *words)
    said = capfd.readouterr().err.strip()
    assert status in {1, 2}
    assert message in said
    assert "Traceback" not in said
    assert not (tmp_path / "out").exists()
