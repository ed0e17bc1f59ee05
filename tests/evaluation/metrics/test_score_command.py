# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world score`: files of every kind, what it prints, and what it refuses."""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest
from pose_texts import kitti_text
from trajectory_pairs import moved, path, rotation
from worlds import ROOT

from noisy_world.cli import command, scoring
from noisy_world.core.trajectory import Trajectory
from noisy_world.evaluate.metrics import METRICS
from noisy_world.evaluate.pose_errors import PROTOCOLS, Alignment
from noisy_world.trajectories.matrix_poses import replica_text
from noisy_world.trajectories.stamped_poses import tum_text

COUNT = 24


@pytest.fixture
def truth():
    return path(np.random.default_rng(6), COUNT)


@pytest.fixture
def files(tmp_path, truth):
    """The truth, and an estimate in another world with every fourth frame lost, as TUM files."""
    kept = np.arange(COUNT) % 4 != 3
    c2w = moved(truth.c2w, rotation(np.random.default_rng(7), 2.0), [4.0, 5.0, 6.0])
    (tmp_path / "truth.txt").write_text(tum_text(truth))
    (tmp_path / "estimate.txt").write_text("# a comment\n" + tum_text(Trajectory(c2w[kept], truth.stamps_s[kept])))
    return tmp_path


def score(capsys, *words, status=0):
    assert command.main(["score", *map(str, words)]) == status
    return capsys.readouterr()


def values(capsys, *words):
    return json.loads(score(capsys, *words, "--json").out)


def test_the_table(files, capsys):
    out = score(capsys, files / "estimate.txt", files / "truth.txt").out
    assert "18 of 24 frames have one of the 18 poses, within 0.01 s; SE(3)" in out
    rows = {line.split()[-1]: line for line in out.splitlines() if line}
    assert "INCOMPLETE: it tracked less than 80 % of the frames" in out
    assert set(METRICS) <= set(rows)
    assert rows["tracked_share"].split()[:3] == ["tracked", "frames", "0.75"]
    assert rows["losses"].split()[:2] == ["losses", "6"]
    assert "FAILED" not in out


def test_json_and_the_errors_of_each_frame(files, truth, capsys):
    found = values(capsys, files / "estimate.txt", files / "truth.txt", "--errors", files / "errors.csv")
    assert (found["protocol"], found["alignment"], found["failure"]) == ("strict", "se3", "")
    assert (found["poses"], found["matched"], found["frames"]) == (18, 18, 24)
    assert list(found["values"]) == list(METRICS)
    assert found["values"]["ate_rmse_m"] < 1e-12
    with (files / "errors.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["tracked"] for row in rows] == ["1", "1", "1", "0"] * 6
    assert [float(row["stamp_s"]) for row in rows] == pytest.approx(truth.stamps_s.tolist())
    assert rows[3] == {"index": "3", "stamp_s": "0.150000000", "tracked": "0"} | dict.fromkeys(
        ("error_m", "rotation_error_deg", "x_m", "y_m", "z_m"), ""
    )
    position = [float(rows[4][name]) for name in ("x_m", "y_m", "z_m")]
    np.testing.assert_allclose(position, truth.c2w[4, :3, 3], atol=1e-12)


def test_a_failed_run_is_a_result(files, truth, capsys):
    (files / "still.txt").write_text(tum_text(Trajectory(np.tile(truth.c2w[0], (COUNT, 1, 1)), truth.stamps_s)))
    (files / "nothing.txt").write_text("# timestamp tx ty tz qx qy qz qw\n\n")
    for name, word in (("still.txt", "stands_still"), ("nothing.txt", "no_poses")):
        out = score(capsys, files / name, files / "truth.txt").out
        assert f"FAILED ({word})" in out
        assert values(capsys, files / name, files / "truth.txt")["failure"] == word
        papers = values(capsys, files / name, files / "truth.txt", "--protocol", "paper")
        assert papers["values"] == {"ate_m": 1.0, "rpe_rad": 1.0, "sr": 0.0}


def test_the_folder_of_a_run_and_of_a_sequence(files, truth, capsys):
    run, sequence = files / "run", files / "sequence"
    run.mkdir()
    (files / "estimate.txt").rename(run / "estimate.txt")
    (run / "keyframes.txt").write_text(tum_text(Trajectory(truth.c2w[::6], truth.stamps_s[::6])))
    (sequence / "results").mkdir(parents=True)
    (sequence / "traj.txt").write_text(replica_text(truth))
    for number in range(COUNT):
        (sequence / f"results/frame{number:06d}.jpg").touch()
        (sequence / f"results/depth{number:06d}.png").touch()
    assert values(capsys, run, files / "truth.txt")["poses"] == 18
    papers = values(capsys, run, files / "truth.txt", "--protocol", "paper")
    assert (papers["poses"], papers["matched"], papers["alignment"]) == (4, 4, "sim3")
    # The sequence says no time, and the estimate has stamps of fewer frames: only a rate can tell.
    refused = score(capsys, run, sequence, status=1)
    assert refused.err.count("\n") == 1
    assert "has no time stamps, and counts 24 frames" in refused.err
    assert "--rate-hz" in refused.err
    assert values(capsys, run, sequence, "--rate-hz", 20)["values"]["ate_rmse_m"] < 1e-12


def test_files_without_stamps(files, truth, capsys):
    (files / "kitti.txt").write_text(kitti_text(truth))
    (files / "replica.txt").write_text(replica_text(truth))
    late = Trajectory(truth.c2w, truth.stamps_s + 1e9)
    (files / "late.txt").write_text(tum_text(late))
    for estimate, true in (("kitti.txt", "replica.txt"), ("kitti.txt", "late.txt"), ("late.txt", "kitti.txt")):
        assert command.main(["score", str(files / estimate), str(files / true), "--json"]) == 0
        said = capsys.readouterr()
        assert json.loads(said.out)["matched"] == COUNT
        assert "note: " in said.err
    assert values(capsys, files / "late.txt", files / "kitti.txt", "--rate-hz", 20)["failure"] == "no_common_stamps"


def test_world_to_camera_poses(files, truth, capsys):
    (files / "w2c.txt").write_text(replica_text(Trajectory(np.linalg.inv(truth.c2w), truth.stamps_s)))
    wrong = values(capsys, files / "w2c.txt", files / "truth.txt")
    right = values(capsys, files / "w2c.txt", files / "truth.txt", "--pose", "w2c")
    assert wrong["values"]["ate_rmse_m"] > 0.01
    assert right["values"]["ate_rmse_m"] < 1e-12


def test_options(files, capsys):
    estimate, true = files / "estimate.txt", files / "truth.txt"
    assert values(capsys, estimate, true, "--monocular")["alignment"] == "sim3"
    assert values(capsys, estimate, true, "--alignment", "none")["values"]["ate_rmse_m"] > 1.0
    assert values(capsys, estimate, true, "--max-difference-s", 0)["max_difference_s"] == 0.0
    assert tuple(PROTOCOLS) == scoring.PROTOCOLS
    assert tuple(Alignment) == scoring.ALIGNMENTS


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("1 1 2 3 0 0 0 1\n0 1 2 3 0 0 0 1\n", "line 2: the time stamp 0 does not come after the one before it"),
        ("0 1 2 nan 0 0 0 1\n", "line 1: holds nan"),
        ("0 1 2 3 0 0 0 7\n", "line 1: the quaternion has length 7, not 1"),
        ("hello\nworld again\n", "line 2"),
    ],
)
def test_bad_files_are_one_line(files, capsys, content, said):
    (files / "bad.txt").write_text(content)
    for words in ((files / "bad.txt", files / "truth.txt"), (files / "estimate.txt", files / "bad.txt")):
        refused = score(capsys, *words, status=1)
        assert refused.err.count("\n") == 1
        assert f"{files / 'bad.txt'}: " in refused.err
        assert said in refused.err


def test_other_mistakes_are_one_line(files, capsys):
    (files / "empty.txt").write_text("")
    for words, said in (
        ((files / "no.txt", files / "truth.txt"), "does not exist"),
        ((files / "estimate.txt", files / "empty.txt"), "holds no pose"),
        ((files / "estimate.txt", files / "truth.txt", "--errors", files / "no" / "errors.csv"), "errors.csv"),
        ((files, files / "truth.txt", "--keyframes", files / "no.txt"), "no.txt: does not exist"),
    ):
        refused = score(capsys, *words, status=1)
        assert refused.err.count("\n") == 1
        assert said in refused.err
    for option in (("--max-difference-s", "-1"), ("--rate-hz", "0"), ("--protocol", "papre")):
        with pytest.raises(SystemExit) as ended:
            command.main(["score", "a", "b", *option])
        assert ended.value.code == 2


def test_the_script(files):
    words = [sys.executable, ROOT / "headless/score.py", files / "estimate.txt", files / "truth.txt", "--json"]
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["matched"] == 18


# --- frames ---


def line(stamp_s):
    """A pose of a smooth path, at any time."""
    return f"{stamp_s:.6f} {0.2 * stamp_s:.6f} {0.3 * np.sin(stamp_s):.6f} {0.1 * np.cos(2 * stamp_s):.6f} 0 0 0 1\n"


@pytest.fixture
def mocap(tmp_path):
    """A truth at 100 Hz over 20 s, and the times of a camera of 30 Hz."""
    (tmp_path / "truth.txt").write_text("".join(line(k / 100) for k in range(2001)))
    return tmp_path, [k / 30 for k in range(601)]


@pytest.mark.parametrize(
    "run",
    [
        (lambda k: True, 1.0, 0, "complete"),
        (lambda k: not 200 <= k < 260, 541 / 601, 1, "complete"),
        (lambda k: k < 300, 300 / 601, 1, "incomplete"),
    ],
)
@pytest.mark.parametrize("said", ["rate", "list", "nanoseconds", "beside"])
def test_coverage_counts_frames_and_not_samples_of_the_truth(mocap, capsys, run, said):
    (folder, times_s), (kept, share, losses, result) = mocap, run
    (folder / "e.txt").write_text("".join(line(t) for k, t in enumerate(times_s) if kept(k)))
    words = [folder / "e.txt", folder / "truth.txt"]
    if said == "list":
        (folder / "times.txt").write_text("# color images\n" + "".join(f"{t:.6f} rgb/{t:.6f}.png\n" for t in times_s))
        words += ["--frames", folder / "times.txt"]
    elif said == "nanoseconds":
        at = 1_400_000_000
        (folder / "data.csv").write_text(
            "#t [ns],name\n" + "".join(f"{at * 10**9 + round(t * 1e9)},x\n" for t in times_s)
        )
        for name in ("e.txt", "truth.txt"):
            rows = [row.split(" ", 1) for row in (folder / name).read_text().splitlines()]
            (folder / name).write_text("".join(f"{float(t) + at:.6f} {rest}\n" for t, rest in rows))
        words += ["--frames", folder / "data.csv"]
    elif said == "beside":
        (folder / "rgb.txt").write_text("".join(f"{t:.6f} rgb/{t:.6f}.png\n" for t in times_s))
    found = values(capsys, *words)
    assert found["values"]["tracked_share"] == pytest.approx(share, abs=0.002)
    assert (found["values"]["losses"], found["result"]) == (losses, result)
    assert {"rate": "30 Hz", "list": "times.txt", "nanoseconds": "data.csv", "beside": "rgb.txt"}[said] in found[
        "frames_from"
    ]
    assert found["values"]["rpe_1frame_rmse_m"] < 0.003  # a frame's motion, and the truth's time off by 5 ms at most
    assert "frames: " in score(capsys, *words).out


def test_keyframes_have_no_rate_of_their_own(mocap, capsys):
    folder, times_s = mocap
    chosen = np.flatnonzero(np.random.default_rng(0).uniform(size=601) < 0.1)
    (folder / "e.txt").write_text("".join(line(times_s[k]) for k in chosen))
    found = values(capsys, folder / "e.txt", folder / "truth.txt")
    assert (found["frames_from"], found["result"]) == ("the samples of the truth", "incomplete")


def test_a_truth_and_an_estimate_with_equal_stamps(tmp_path, capsys):
    # Of two equal ones the first is kept: then evo's figure of the file without the second is ours, 0 here.
    rows = [line(k / 20) for k in range(40)]
    (tmp_path / "good.txt").write_text("".join(rows))
    (tmp_path / "twice.txt").write_text("".join([*rows[:20], rows[19].replace(" 0 0 0 1", " 1 0 0 0"), *rows[20:]]))
    for words in (("good.txt", "twice.txt"), ("twice.txt", "good.txt")):
        done = score(capsys, *(tmp_path / name for name in words), "--json")
        assert json.loads(done.out)["values"]["ate_rmse_m"] < 1e-12
        assert json.loads(done.out)["values"]["ate_rotation_max_deg"] < 1e-6
        assert "line 21" in done.err


@pytest.mark.parametrize("format_name", ["auto", "array"])
def test_other_formats_are_read(files, truth, capsys, format_name):
    np.save(files / "poses.npy", truth.c2w)
    found = values(capsys, files / "poses.npy", files / "truth.txt", "--format", format_name)
    assert found["values"]["ate_rmse_m"] < 1e-12
    assert "no format" in score(capsys, files / "poses.npy", files / "truth.txt", "--format", "arrays", status=1).err
