# SPDX-License-Identifier: GPL-3.0-or-later
"""The time stamps of recordings: lists, frames.jsonl, or a rate; from files written by hand."""

import json

import cv2
import numpy as np
from refusals import refused
from cases import cases

from noisy_world.layouts import find_sequence
from noisy_world.core.schema import ConfigPath
from noisy_world.sources.recording import read_recording

POSE = "1 0 0 {} 0 1 0 0 0 0 1 0 0 0 0 1\n"


def write_replica(folder, numbers=(0, 1, 2), times=None):
    """Frames of these numbers; times: lines of frames.jsonl, as text or as values."""
    (folder / "results").mkdir(parents=True)
    for k in numbers:
        assert cv2.imwrite(str(folder / f"results/frame{k:06d}.png"), np.full((2, 3, 3), k % 256, np.uint8))
        assert cv2.imwrite(str(folder / f"results/depth{k:06d}.png"), np.full((2, 3), 1000 + k % 256, np.uint16))
    (folder / "traj.txt").write_text("".join(POSE.format(k) for k in numbers))
    if times is not None:
        lines = [item if isinstance(item, str) else json.dumps(item) for item in times]
        (folder / "frames.jsonl").write_text("".join(f"{line}\n" for line in lines))
    return folder


def write_tum(folder, rgb, depth, poses):
    """Lists whose lines are given; each distinct file that they name is made."""
    for kind, rows in (("rgb", rgb), ("depth", depth)):
        (folder / kind).mkdir(parents=True)
        for row in rows:
            if not row.startswith("#"):
                pixels = np.zeros((2, 3, 3), np.uint8) if kind == "rgb" else np.ones((2, 3), np.uint16)
                assert cv2.imwrite(str(folder / row.replace(",", " ").split()[1]), pixels)
        (folder / f"{kind}.txt").write_text("\n".join(rows) + "\n")
    (folder / "groundtruth.txt").write_text("".join(f"{t} {k} 0 0 0 0 0 1\n" for k, t in enumerate(poses)))
    return folder


def seconds(folder, rate_hz=None):
    stamps = find_sequence(folder, rate_hz).stamps
    return [part.seconds.tolist() for part in (stamps.rgb, stamps.depth, stamps.pose)]


# --- Replica ---


def test_without_stamps_a_frames_number_is_its_time(tmp_path):
    assert seconds(write_replica(tmp_path / "a"))[0] == [0, 0.05, 0.1]
    assert seconds(tmp_path / "a", rate_hz=40)[0] == [0, 0.025, 0.05]
    assert find_sequence(tmp_path / "a").notes == ("no file says time stamps: 20 frames a second, or rate_hz",)
    assert find_sequence(tmp_path / "a", 40).notes == ()
    named_by_time = write_replica(tmp_path / "ns", numbers=(1305031102175304000,))
    refused(find_sequence, named_by_time, names=("frame1305031102175304000.png: ", "too large"))
    found = find_sequence(write_replica(tmp_path / "b", numbers=(100, 103, 104)))
    assert found.stamps.rgb.seconds.tolist() == [5, 5.15, 5.2]
    assert found.stamps_path is None
    assert [found.frame(k).rgb[0, 0, 0] for k in range(3)] == [100, 103, 104]
    assert [round(float(found.frame(k).depth_m[0, 0]) * 6553.5) for k in range(3)] == [1100, 1103, 1104]
    assert found.trajectory.c2w[:, 0, 3].tolist() == [100, 103, 104]


def test_frames_jsonl_says_the_stamps_by_the_frames_numbers(tmp_path):
    times = [{"frame": k, "time_s": 1.4e9 + t, "sha256": {}} for k, t in ((7, 0.5), (2, 0.25), (0, 0.0), (1, 0.1))]
    times[1]["depth_time_s"] = 1.4e9 + 0.26
    folder = write_replica(tmp_path / "a", numbers=(0, 2, 7), times=times)
    assert seconds(folder) == [
        [1.4e9, 1.4e9 + 0.25, 1.4e9 + 0.5],
        [1.4e9, 1.4e9 + 0.26, 1.4e9 + 0.5],
        [1.4e9, 1.4e9 + 0.25, 1.4e9 + 0.5],
    ]
    assert find_sequence(folder).stamps_path == folder / "frames.jsonl"


LINE = {"frame": 0, "time_s": 0.0}


@cases(
    ["lines", "words"],
    [
        ([LINE, {"frame": 1, "time_s": 0.1}], "has no line for frame 2"),
        ([LINE, {"frame": 1, "time_s": 0.1}, {"frame": 2, "time_s": 0.1}], "frame 2 is not later than the one before"),
        ([LINE, LINE], "line 2: is no line for a frame of its own"),
        ([{"frame": True, "time_s": 0}], "line 1: is no line for a frame"),
        ([{"frame": -1, "time_s": 0}], "line 1: is no line for a frame"),
        ([{"time_s": 0}], "line 1: is no line for a frame"),
        (["[1]"], "line 1: is no line for a frame"),
        ([{"frame": 0}], "line 1: has no time stamp"),
        ([{"frame": 0, "time_s": "0"}], "line 1: has no time stamp"),
        ([{"frame": 0, "time_s": 0, "depth_time_s": None}], "line 1: has no time stamp"),
        (['{"frame": 0, "time_s": NaN}'], "line 1: is not valid JSON"),
        (['{"frame": 0, "time_s": 1e999}'], "line 1: is not valid JSON: it holds 1e999"),
        (['{"frame": 0, "ti'], "line 1: is not valid JSON"),
        (["[" * 100_000], "line 1: is not valid JSON: it is nested too deeply"),
        ([], "has no line for frame 0"),
    ],
)
def test_a_damaged_frames_jsonl_is_one_line(tmp_path, lines, words):
    folder = write_replica(tmp_path / f"{abs(hash(str(lines)))}", times=lines)
    refused(find_sequence, folder, names=(words, "frames.jsonl", "rate_hz"))


def test_a_folder_for_frames_jsonl_is_one_line(tmp_path):
    folder = write_replica(tmp_path / "a")
    (folder / "frames.jsonl").mkdir()
    refused(find_sequence, folder, names="frames.jsonl: cannot be read")


# --- a rate that the preset says ---


def test_a_rate_that_the_recordings_stamps_contradict(tmp_path):
    place = ConfigPath("p.yaml", "scenes.0")
    ntsc = [{"frame": k, "time_s": k * 1001 / 30000} for k in range(3)]
    folder = write_replica(tmp_path / "a", times=ntsc)
    for rate_hz in (30, 29.97, None):
        assert read_recording(folder, place, rate_hz).stamps_s.tolist() == [k * 1001 / 30000 for k in range(3)]
    refused(
        read_recording,
        folder,
        place,
        20,
        names=("scenes.0.rate_hz: ", "frames.jsonl says 29.97 Hz"),
    )
    times = ["0.0", "0.04", "0.08"]
    rows = [[f"{t} {kind}/{k}.png" for k, t in enumerate(times)] for kind in ("rgb", "depth")]
    tum = write_tum(tmp_path / "t", *rows, times)
    refused(read_recording, tum, place, 60, names=("is 60 Hz, but ", "rgb.txt says 25 Hz"))
    assert len(read_recording(tum, place, 25).stamps_s) == 3
    # Every fifth image of a recording of 20 Hz, without stamps: the rate is that of the numbers.
    fifth = write_replica(tmp_path / "c", numbers=(0, 5, 10))
    assert read_recording(fifth, place, 20).stamps_s.tolist() == [0, 0.25, 0.5]


# --- TUM ---


def test_colour_depth_and_poses_keep_their_own_stamps(tmp_path):
    found = find_sequence(
        write_tum(
            tmp_path / "t",
            ["# color images", "# file: 'x.bag'", "# timestamp filename", "10.05 rgb/b.png", "10.0 rgb/a.png"],
            ["10.007 depth/x.png", "10.043,depth/y.png", "99 depth/z.png"],
            ["9.99", "10.001", "10.052"],
        )
    )
    parts = (found.stamps.rgb, found.stamps.depth, found.stamps.pose)
    assert [part.seconds.tolist() for part in parts] == [[10.0, 10.05], [10.007, 10.043], [10.001, 10.052]]
    assert found.stamps.rgb.ns == (10_000_000_000, 10_050_000_000)
    assert [file.name for file in found.rgb_files] == ["a.png", "b.png"]
    assert [file.name for file in found.depth_files] == ["x.png", "y.png"]
    assert found.trajectory.c2w[:, 0, 3].tolist() == [1, 2]
    assert found.trajectory.stamps_s.tolist() == [10.0, 10.05]
    assert found.notes == ()


def test_what_association_leaves_out_is_said(tmp_path):
    rgb = [f"{k / 20} rgb/{k}.png" for k in range(10)]
    depth = [f"{k / 20} depth/{k}.png" for k in range(10) if k not in (3, 4)]
    folder = write_tum(tmp_path / "t", rgb, depth, [k / 20 for k in range(9)])
    said = "3 of 10 colour images are left out: 2 with no depth image, 1 with no pose within 0.02 s"
    assert find_sequence(folder).notes == (said,)
    notes = []
    recording = read_recording(folder, ConfigPath("p"), None)
    with recording.prepare(None, notes.append):
        assert notes == [said]


@cases(
    ["line", "words"],
    [
        ("0.0 rgb/b.png", "line 2: the time stamp 0.0 is that of an earlier line"),
        ("0.000 rgb/b.png", "line 2: the time stamp 0.000 is that of an earlier line"),
        ("nan rgb/b.png", "line 2: is no time stamp and file name"),
        ("inf rgb/b.png", "line 2: is no time stamp and file name"),
        ("1_0 rgb/b.png", "line 2: is no time stamp and file name"),
        ("1e9999 rgb/b.png", "line 2: is no time stamp and file name"),
        ("\u0661 rgb/b.png", "line 2: is no time stamp and file name"),
        ("1.0", "line 2: is no time stamp and file name"),
        ("1305031102175304000 rgb/b.png", "line 2: 1305031102175304000 s is 41353940166 years; write the stamps in"),
        ("1305031102.17530401 rgb/b.png", "equal in float64"),
    ],
)
def test_a_wrong_line_of_a_list(tmp_path, line, words):
    folder = write_tum(tmp_path / f"{abs(hash(line))}", ["0.0 rgb/a.png"], ["0.0 depth/a.png"], ["0.0"])
    first = "1305031102.175304" if line.startswith("1305031102.") else "0.0"
    (folder / "rgb.txt").write_text(f"{first} rgb/a.png\n{line}\n")
    refused(find_sequence, folder, names=(words, "rgb.txt"))


def test_a_list_that_names_what_is_not_there(tmp_path):
    folder = write_tum(tmp_path, ["0.0 rgb/a.png"], ["0.0 depth/a.png"], ["0.0"])
    (folder / "depth/a.png").unlink()
    refused(find_sequence, folder, names=("depth.txt: ", "a.png", f"looked in {folder}/depth"))
    (folder / "depth.txt").write_text("# nothing\n")
    refused(find_sequence, folder, names="depth.txt: lists no image")
