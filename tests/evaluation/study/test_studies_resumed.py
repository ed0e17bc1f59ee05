# SPDX-License-Identifier: GPL-3.0-or-later
"""A study that is ended at any moment, by a signal or before any write, and done again: the same files to the byte."""

import random
import signal
import subprocess
import sys
import time

import pytest
from study_tools import evaluate, small_world, told, write_systems
from worlds import ROOT

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("tabulate", reason="tabulate comes with an extra")

SETTINGS = [{"name": "clean"}, {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}]}]


class PowerCutError(BaseException):
    """Ends the process, as far as a test can."""


def arguments(folder, out, *more):
    systems = ",".join(str(folder / f"systems/{kind}.yaml") for kind in ("half", "crash"))
    return [folder / "world/preset.yaml", "--systems", systems, "--seeds", "1,2", "--out", out, *more]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("killed")
    small_world(folder / "world", settings=SETTINGS)
    write_systems(folder / "systems", "half", "crash")
    assert evaluate(*arguments(folder, folder / "whole", "--jobs", 1)) == 0
    return folder


def test_ended_before_any_write(study, tmp_path, monkeypatch):
    """The working folder's lock is released by the system, so the next run takes up what is there."""
    from noisy_world.evaluate import study_results

    write, writes = study_results.write_atomic, []

    def ending(path, data, scratch):
        writes.append(path)
        if len(writes) == ending.at:
            raise PowerCutError
        write(path, data, scratch)

    monkeypatch.setattr(study_results, "write_atomic", ending)
    # Within the first sequence, within the last, and at the tables.
    for number, at in enumerate((2, 9, 16)):
        ending.at = at
        writes.clear()
        out = tmp_path / str(number)
        with pytest.raises(PowerCutError):
            evaluate(*arguments(study, out, "--jobs", 1))
        ending.at = 0
        assert evaluate(*arguments(study, out, "--jobs", 1)) == 0
        assert told(out) == told(study / "whole"), f"ended before {writes[-1]}"


def test_killed_at_random_moments(study, tmp_path):
    draw = random.Random(5)
    command = [sys.executable, str(ROOT / "headless/evaluate.py")]
    command += map(str, arguments(study, tmp_path / "out", "--jobs", 2, "--no-report"))
    killed = 0
    for runs in range(3):
        process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        while process.poll() is None and len([*(tmp_path / "out").rglob("run.json")]) < runs:
            time.sleep(0.005)
        time.sleep(draw.uniform(0.0, 0.3) if runs else 1.0)  # while it starts, and after each of two runs
        killed += process.poll() is None
        process.kill()
        process.communicate(timeout=300)  # ends when the workers do, which have its standard error
    assert killed, "each run came to its end before it was killed"
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert told(tmp_path / "out") == told(study / "whole")


def test_stopped_by_ctrl_c_it_says_how_to_go_on(study, tmp_path):
    write_systems(tmp_path / "systems", "hang")
    (definition,) = tmp_path.glob("systems/*.yaml")
    definition.write_text(definition.read_text().replace("start_s: 1.0", "start_s: 600.0"))
    command = [sys.executable, str(ROOT / "headless/evaluate.py"), str(study / "world/preset.yaml")]
    command += ["--systems", str(definition), "--out", str(tmp_path / "out"), "--jobs", "1"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    log = tmp_path / "out/runs/box/clean/seed-3/hang/repeat-1/log.txt"
    deadline = time.monotonic() + 120
    while not log.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.rstrip().splitlines()[-1].startswith("  ")
    assert "the same command continues from there" in said
    assert "Traceback" not in said
