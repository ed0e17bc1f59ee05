# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world threshold` from preset to figure, with a system that bears a delay of three frames."""

import contextlib
import csv
import io
import json
import os
import signal
import subprocess
import sys
import time

import pytest
import yaml
from study_tools import small_world, write_systems
from worlds import ROOT

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
SEARCH = ("--perturbation", "desync", "--from", "1", "--to", "11", "--most", "10")  # whose interval is narrow enough
TRIALS = "desync.offset/patient.threshold.json"


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


@pytest.fixture(scope="module")
def whole(world, tmp_path_factory):
    """A folder of thresholds with a search that nothing disturbed, and what it printed."""
    out, said = tmp_path_factory.mktemp("whole") / "out", io.StringIO()
    with contextlib.redirect_stdout(said):
        assert search(world, out) == 0
    return out, said.getvalue()


def results_of(out):
    return {name: (out / name).read_bytes() for name in (TRIALS, "thresholds.csv", "thresholds.svg")}


def test_a_threshold_is_found(whole):
    out, text = whole
    (said,) = (line for line in text.splitlines() if line.startswith("patient"))
    assert "patient, desync.offset: the threshold is " in said
    assert " frames (95 %: " in said
    content = json.loads((out / TRIALS).read_text())
    assert 3 < content["found"]["threshold"] < 4.2
    assert {trial["succeeded"] for trial in content["trials"] if trial["value"] <= 3} == {True}
    assert {trial["succeeded"] for trial in content["trials"] if trial["value"] > 3} == {False}
    assert {trial["outcome"] for trial in content["trials"]} == {"finished", "crashed"}
    (row,) = csv.DictReader((out / "thresholds.csv").open(newline=""))
    assert (row["system"], row["parameter"], row["unit"], row["verdict"]) == ("patient", "offset", "frames", "found")
    assert float(row["mild_end"]) < float(row["threshold"]) < float(row["worst_end"])
    assert b"<svg" in (out / "thresholds.svg").read_bytes()


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="needs process groups")
def test_a_search_that_ended_or_was_killed_goes_on(world, whole, tmp_path, capfd):
    count = len(json.loads((whole[0] / TRIALS).read_text())["trials"])
    assert search(world, tmp_path, "--most", 2) == 0
    assert "wider than asked for" in capfd.readouterr().out
    assert made_in(tmp_path) == 2

    words = ["threshold", world / "preset.yaml", "--system", world / "patient.yaml", *SEARCH, "--out", tmp_path]
    process = subprocess.Popen(
        [sys.executable, "-m", "noisy_world", *map(str, words)],
        env=os.environ | {"PYTHONPATH": str(ROOT / "addon")},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < deadline and made_in(tmp_path) < 4:
        time.sleep(0.005)
    assert process.poll() is None, process.communicate()[0]
    os.killpg(process.pid, signal.SIGKILL)  # with the system's process: in the middle of a run, or between two
    process.communicate(timeout=60)
    assert 4 <= made_in(tmp_path) < count

    assert search(world, tmp_path) == 0
    assert results_of(tmp_path) == results_of(whole[0])
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in whole[0].iterdir())


def made_in(out):
    """How many trials a search has written, which it does whole or not at all."""
    return len(json.loads((out / TRIALS).read_text())["trials"]) if (out / TRIALS).exists() else 0


def test_without_a_limit_the_bound_is_said(world, tmp_path, capfd):
    assert search(world, tmp_path, "--most", 40, system="fine") == 0
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
        ((*SEARCH, "--system", "patien"), "--system: unknown system 'patien'"),
    ],
)
def test_bad_input_is_one_line(world, tmp_path, capfd, words, message):
    status = threshold(world / "preset.yaml", "--system", world / "fine.yaml", "--out", tmp_path / "out", *words)
    said = capfd.readouterr().err.strip()
    assert status in {1, 2}
    assert message in said
    assert "Traceback" not in said
    assert not (tmp_path / "out").exists()
