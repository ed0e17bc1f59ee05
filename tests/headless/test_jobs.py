# SPDX-License-Identifier: GPL-3.0-or-later
"""More processes than are of use are not started, and a line says so; what Blender prints in vain is not shown."""

import json
import os
import sys

import pytest
from worlds import content, generate, generate_here, write_world

from noisy_world.cli import entry, shard_workers


@pytest.mark.parametrize(
    ("asked", "there", "jobs", "words"),
    [
        (1, (8, 100), 1, ""),
        (8, (8, 100), 8, ""),
        (9, (8, 100), 8, "--jobs 9 is more than is of use with 8 processors, so it is taken as 8"),
        (10**12, (1, 100), 1, "with 1 processor, so it is taken as 1"),
        (8, (8, 3), 3, "with 3 frames, so it is taken as 3"),
        (2, (8, 1), 1, "with 1 frame, so it is taken as 1"),
        (1, (8, 0), 1, ""),
    ],
)
def test_what_is_of_use(monkeypatch, asked, there, jobs, words):
    threads, frames = there
    monkeypatch.setattr(shard_workers, "available_threads", lambda: threads)
    taken, said = shard_workers.useful_jobs(asked, frames)
    assert taken == jobs
    assert words in said
    assert bool(words) == bool(said)
    assert "\n" not in said


def test_too_many_jobs_change_nothing_but_the_line(tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    preset = write_world(tmp_path, frames=3, render={"engine": "embree", "backend": "reference"})
    generate_here(preset, "--out", tmp_path / "one")
    many = generate(preset, "--out", tmp_path / "many", "--jobs", 64, env=os.environ | {"PYTHON_CPU_COUNT": "2"})
    assert many.stderr.splitlines()[0] == "--jobs 64 is more than is of use with 2 processors, so it is taken as 2"
    assert content(tmp_path / "many") == content(tmp_path / "one")
    assert json.loads((tmp_path / "many/run.json").read_text())["jobs"] == 2


@pytest.mark.parametrize("number", ["0", "-1", "two", "1.5", "9" * 5000])
def test_what_is_no_number_of_processes_is_refused(tmp_path, number):
    result = generate_here(write_world(tmp_path), "--jobs", number, check=False)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr


def fail_to_import():
    with entry._relevant_output():
        os.write(1, b"why\n")
        raise ImportError


@pytest.mark.skipif(sys.platform != "linux", reason="Blender prints it on Linux alone")
def test_a_warning_that_concerns_nobody_is_left_out_and_all_others_are_printed(capfd):
    with entry._relevant_output():
        os.write(1, b"00:00.253  system.path      | WARNING Could not get a list of mounted file-systems\n")
        os.write(1, b'00:00.253  translation      | WARNING Falling back to standard locale ("C")\n')
        os.write(1, b"00:00.254  system.path      | WARNING the disk burns\n")
        print("from Python")
        os.write(2, b"on standard error\n")
    print("afterwards")
    said = capfd.readouterr()
    assert set(said.out.splitlines()) == {  # pytest's own stream has another order
        "00:00.254  system.path      | WARNING the disk burns", "from Python", "afterwards",
    }  # fmt: skip
    assert said.err == "on standard error\n"
    with pytest.raises(ImportError):
        fail_to_import()
    assert capfd.readouterr().out == "why\n"
