# SPDX-License-Identifier: GPL-3.0-or-later
"""Sequences as VSLAM-LAB has them: pairs whatever their stamps, other columns, and what is wrong with a file."""

import numpy as np
import pytest
from refusals import refused
from stored_sequences import STAMPS_NS, write_vslamlab

from noisy_world.layouts import LAYOUTS, find_sequence
from noisy_world.core.trajectory import FrameStamps, Stamps


def test_as_its_own_files_are(tmp_path):
    write_vslamlab(tmp_path)
    found = find_sequence(tmp_path)
    camera = found.known_camera
    assert (camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (
        8, 6, 7.5, 7.25, 3.5, 2.5,
    )  # fmt: skip
    assert found.stamps.rgb.ns == found.stamps.depth.ns == found.stamps.pose.ns == STAMPS_NS
    # (w, x, y, z) = (0.5, 0.5, -0.5, 0.5)
    assert np.allclose(found.trajectory.c2w[1], [[0, -1, 0, 1], [0, 0, -1, 2], [1, 0, 0, 3], [0, 0, 0, 1]])
    frame = found.frame(1)
    assert frame.rgb[0, 0].tolist() == [30, 20, 10]
    assert np.allclose(frame.depth_m, 2.5)


def test_pairs_are_those_of_the_list_whatever_their_stamps(tmp_path):
    write_vslamlab(tmp_path, depth_late_ns=3_000_000_000)
    text = (tmp_path / "rgb.csv").read_text().splitlines()
    (tmp_path / "rgb.csv").write_text("\r\n".join([text[0], *reversed(text[1:])]))
    found = find_sequence(tmp_path)
    assert found.stamps.rgb.ns == STAMPS_NS
    assert found.stamps.depth.ns == tuple(stamp_ns + 3_000_000_000 for stamp_ns in STAMPS_NS)
    assert [int(path.stem) for path in found.depth_files] == list(found.stamps.depth.ns)
    assert found.notes == ()


def test_other_columns_and_poses_at_other_times(tmp_path):
    write_vslamlab(tmp_path)
    first, *rest = (tmp_path / "rgb.csv").read_text().splitlines()
    rows = [f"ts_rgb_1 (ns),path_rgb_1,{first}", *(f"0,rgb_1/a.png,{row}" for row in rest)]
    (tmp_path / "rgb.csv").write_text("\n".join(rows))
    poses = (tmp_path / "groundtruth.csv").read_text().splitlines()
    shifted = [row.replace(str(STAMPS_NS[1]), str(STAMPS_NS[1] + 10**9)) for row in poses]
    (tmp_path / "groundtruth.csv").write_text("\n".join(shifted))
    found = find_sequence(tmp_path)
    assert found.stamps.rgb.ns == STAMPS_NS[:1]
    assert found.notes == ("1 of 2 colour images are left out: 1 with no pose within 0.02 s",)


LISTED = f"{STAMPS_NS[0]},rgb_0/{STAMPS_NS[0]}.png,{STAMPS_NS[0]},depth_0/{STAMPS_NS[0]}.png"


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("rgb.csv", ",path_depth_0", ",depth", "rgb.csv: has no column path_depth_0; it has to have"),
        ("rgb.csv", LISTED, f"{LISTED}\n{LISTED}", f"line 3: the time stamp {STAMPS_NS[0]} is that of an earlier line"),
        ("rgb.csv", f"\n{STAMPS_NS[0]}", "\n1.5", "line 2: '1.5' is no time in whole nanoseconds"),
        ("rgb.csv", f"depth_0/{STAMPS_NS[0]}.png", "", "line 2: names no colour or no depth image"),
        ("rgb.csv", LISTED, "1,2", "line 2: has 2 values for 4 columns"),
        ("rgb.csv", LISTED, '"', "is no table"),
        ("rgb.csv", f"rgb_0/{STAMPS_NS[0]}", "rgb_0/none", "names none.png, which is not there"),
        ("calibration.yaml", "cam_name: rgb_0", "cam_name: rgb_7", "describes 0 cameras of the name rgb_0"),
        ("calibration.yaml", "cam_model: pinhole", "cam_model: equid4", "rgb_0.cam_model: is 'equid4', but only"),
        ("calibration.yaml", "     depth_factor: 2000.0,\n", "", "rgb_0.depth_factor: is null, but has"),
        ("calibration.yaml", "depth_factor: 2000.0", "depth_factor: 0", "rgb_0.depth_factor: is 0, but has"),
        ("calibration.yaml", "[7.5, 7.25]", "[7.5]", "rgb_0.focal_length: has to be 2 numbers, finite"),
        ("calibration.yaml", "0.0000000000000, 1.0000000000000]", "0.1, 1.0]", "rgb_0.T_BS: is not the identity"),
        ("calibration.yaml", "fps: 30.0", "distortion_coefficients: [0.1, 0]", "is 'None' with 2 coefficients"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, name, old, new, words):
    write_vslamlab(tmp_path)
    text = (tmp_path / name).read_text()
    assert old in text
    (tmp_path / name).write_text(text.replace(old, new, 1))
    refused(find_sequence, tmp_path, names=(name, words))


def test_stamps_that_rows_cannot_have():
    problem = LAYOUTS["vslamlab"].stamps_problem
    assert problem([0.0, 1e-9]) == ""
    assert problem([-1.0, 0.5]) == ""
    assert problem([0.0, 1e-10]).startswith("frame 1 has the time stamp of an earlier one, in the nanoseconds")
    assert problem([0.0, 1e10]).startswith("frame 1 is at 1e+10 s, but stamps are nanoseconds in 64 bits")
    same = Stamps.of_ns([5, 5])
    own = Stamps.of_ns([1, 2])
    assert problem(FrameStamps(own, same, own)) == ""
    assert problem(FrameStamps(own, own, same)).startswith("the pose of frame 1 has the time stamp")
