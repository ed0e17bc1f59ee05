# SPDX-License-Identifier: GPL-3.0-or-later
"""Results that exist already, and formats that are no text of poses, as systems whose runs have a record."""

import pytest
from refusals import refused
from slam_systems import script_system, write_recording

from noisy_world.evaluate.cases import Case, Outcome, SystemRun, read_estimate_file
from noisy_world.evaluate.configurations import CONFIGURATIONS
from noisy_world.evaluate.system_runs import run_system
from noisy_world.evaluate.systems import find_system, read_system

HEAD = "ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw\n"


@pytest.fixture
def sequence(tmp_path):
    return write_recording(tmp_path / "sequence", 6)


def copies(folder, command, writes):
    folder.mkdir(exist_ok=True)
    (folder / "copied.yaml").write_text(f"name: copied\ncommand: {command}\nwrites: {writes}\n")
    return read_system(folder / "copied.yaml")


def test_a_result_that_exists_is_a_system_that_copies_it(tmp_path, sequence):
    results = tmp_path / "mine/fog/room"
    results.mkdir(parents=True)
    (results / "00002_KeyFrameTrajectory.csv").write_text(HEAD + "150000000,1,2,3,0,0,0,1\n50000000,4,5,6,0,0,0,1\n")
    command = '[cp, "{here}/{setting}/{scene}/0000{repeat}_KeyFrameTrajectory.csv", "{out}/result.csv"]'
    system = copies(tmp_path / "mine", command, "{file: result.csv, format: vslamlab}")
    run = SystemRun(Case("room", "fog", 7), "copied", 2)
    record = run_system(system, sequence, tmp_path / "run", names=run.placeholders)
    assert (record.outcome, record.detail) == (Outcome.FINISHED, "")
    found = read_estimate_file(tmp_path / "run/estimate.txt")
    assert found.stamps_s.tolist() == [0.05, 0.15]
    assert found.c2w[:, :3, 3].tolist() == [[4, 5, 6], [1, 2, 3]]
    missing = run_system(system, sequence, tmp_path / "none", names={**run.placeholders, "repeat": "3"})
    assert missing.outcome is Outcome.CRASHED  # cp says why, in the log
    refused(run_system, system, sequence, tmp_path / "run", names=["copied.yaml: command: ", "{scene}"])


@pytest.mark.parametrize(
    ("text", "outcome", "detail"),
    [
        (HEAD, Outcome.FINISHED, ""),
        (HEAD + "0,nan,2,3,0,0,0,1\n", Outcome.NOT_FINITE, "r.csv: line 2: holds nan"),
        (HEAD + "0,1,2,3\n", Outcome.UNREADABLE, "r.csv: line 2: 4 numbers"),
        (
            HEAD + "0,1,2,3,0,0,0,1\n60000000,1,2,3,0,0,0,1\n75000001,1,2,3,0,0,0,1\n",
            Outcome.FINISHED,
            "1 of 3 poses belong",
        ),
        (None, Outcome.NO_ESTIMATE, "it wrote no r.csv"),
    ],
)
def test_every_end_is_a_record(tmp_path, sequence, text, outcome, detail):
    script = "" if text is None else f"write({text!r}, 'r.csv')\n"
    system = script_system(tmp_path / "s", script, writes={"file": "r.csv", "format": "vslamlab"})
    record = run_system(system, sequence, tmp_path / "run")
    assert record.outcome is outcome
    assert record.detail.startswith(detail)


def test_colmap_names_the_images(tmp_path, sequence):
    script = "write('1 1 0 0 0 -0.25 0 0 1 ' + os.path.basename(frames[4]['colour']) + '\\n\\n', 'images.txt')\n"
    system = script_system(tmp_path / "s", script, writes={"file": "images.txt", "format": "colmap"})
    assert run_system(system, sequence, tmp_path / "run").outcome is Outcome.FINISHED
    found = read_estimate_file(tmp_path / "run/estimate.txt")
    assert (found.stamps_s.tolist(), found.c2w[0, 0, 3]) == ([0.2], 0.25)


def test_what_a_format_says_itself_cannot_be_said(tmp_path):
    for writes, names in (
        ("{file: a, format: colmap, axes: opengl}", ["copied.yaml: writes.axes: ", "colmap"]),
        ("{file: a, format: splatam, stamps: index}", ["copied.yaml: writes.stamps: ", "splatam"]),
    ):
        refused(copies, tmp_path, "[x]", writes, names=names)
    assert copies(tmp_path, "[x]", "{file: a, format: array, direction: w2c}").writes.direction == "w2c"


def test_the_shipped_neural_systems():
    for name in CONFIGURATIONS:
        system = find_system(name)
        assert name in system.command
        assert system.gpu
        assert system.reads.monocular == name.endswith("_mono")
        assert "other_systems.md" in system.remedy
