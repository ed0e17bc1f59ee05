# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of poses as systems and tools write them, told by header or content."""

import numpy as np
import pytest
from pose_texts import NS, POSITIONS, QUATS, is_expected, rows

from noisy_world.trajectories.formats import read_trajectory_file

SECONDS = [ns / 10**9 for ns in NS]
STAMPS = [f"{second:.9f}" for second in SECONDS]
COVARIANCE = " ".join(f"P{of}{place}" for of in "rt" for place in ("11", "12", "13", "22", "23", "33"))
OPENVINS = f"# timestamp(s) tx ty tz qx qy qz qw {COVARIANCE}\n"  # ov_eval/src/utils/Recorder.h
MAPLAB = (  # export-vertex-data.cc, format asl
    "# timestamp [ns], vertex-id, mission-id, p_G_Ix [m], p_G_Iy [m], p_G_Iz [m], q_G_Iw, q_G_Ix, q_G_Iy, q_G_Iz, "
    "p_M_Ix [m], p_M_Iy [m], p_M_Iz [m], q_M_Iw, q_M_Ix, q_M_Iy, q_M_Iz, v_Mx [m/s], bgx [rad/s], bax [m/s^2]\n"
)


def cells(stamps, before, order, separator=",", after=()):
    """Lines of stamps, other cells, poses in an order such as pxyzw, and other cells."""
    lines = rows([separator.join([str(stamp), *before]) for stamp in stamps], order, separator).splitlines()
    return "".join(separator.join([line, *after]) + "\n" for line in lines)


def rostopic(pose, after=()):
    fields = [f"field.{pose[0]}.{axis}" for axis in "xyz"] + [f"field.{pose[1]}.{axis}" for axis in "xyzw"]
    head = ",".join(["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id", *fields, *after])
    lines = [f"{ns + 5_000_000},{k},{ns},map" for k, ns in enumerate(NS)]  # received 5 ms later than measured
    return f"{head}\n" + cells(lines, [], "pxyzw", after=["0.1"] * len(after))


def state_estimate():
    """ov_msckf's total state: the quaternion, x y z w, before the position."""
    head = "# timestamp(s) q p v bg ba cam_imu_dt num_cam cam0_k cam0_d cam0_rot cam0_trans ... imu_model dw da\n"
    poses = np.concatenate([np.roll(QUATS, -1, axis=1), POSITIONS], axis=1).tolist()
    lines = zip(STAMPS, poses, strict=True)
    return head + "".join(" ".join([stamp, *map(repr, pose), *["0"] * 30]) + "\n" for stamp, pose in lines)


TABLES = {
    "OpenVINS, 20 columns": ("tum", OPENVINS + cells(STAMPS, [], "pxyzw", " ", ["1e-4"] * 12)),
    "OpenVINS, 14 columns": ("tum", cells(STAMPS, [], "pxyzw", " ", ["1e-4"] * 6)),
    "OpenVINS, 20 columns without a header": ("tum", cells(STAMPS, [], "pxyzw", " ", ["1e-4"] * 12)),
    "OpenVINS, no covariance under a header with it": ("tum", OPENVINS + cells(STAMPS, [], "pxyzw", " ")),
    "OpenVINS, state_estimate.txt": ("tum", state_estimate()),
    "VINS-Fusion's vio.csv": ("euroc", cells(NS, [], "pwxyz", ",", ["0.1", "0.2", "0.3", ""])),
    "VINS-Fusion's vio_loop.csv": ("euroc", cells(NS, [], "pwxyz", ",", [""])),
    "RTAB-Map with ids": ("tum", "#timestamp x y z qx qy qz qw id\n" + cells(STAMPS, [], "pxyzw", " ", ["7"])),
    "rostopic, PoseStamped": ("tum", rostopic(("pose.position", "pose.orientation"))),
    "rostopic, TransformStamped": ("tum", rostopic(("transform.translation", "transform.rotation"))),
    "rostopic, Odometry": (
        "tum",
        rostopic(
            ("pose.pose.position", "pose.pose.orientation"),
            ["field.pose.covariance0", "field.twist.twist.linear.x", "field.twist.twist.angular.z"],
        ),
    ),
    "MCD": ("tum", "num,t,x,y,z,qx,qy,qz,qw\n" + cells([f"7,{stamp}" for stamp in STAMPS], [], "pxyzw")),
    "maplab": ("euroc", MAPLAB + cells(NS, ["0a1f", "77be"], "pwxyz", ", ", [*"0001000", "0", "0", "0"])),
    "ORB-SLAM3": ("tum", rows([f"{ns}.000000" for ns in NS], "pxyzw", " ")),
    "a spreadsheet": (
        "tum",
        ("\ufefft;x;y;z;qx;qy;qz;qw;note\n" + cells(STAMPS, [], "pxyzw", ";", ["a, b"])).replace("\n", "\r\n"),
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_known_systems(write, name):
    format_name, text = TABLES[name]
    found = read_trajectory_file(write(text))
    assert found.format == format_name
    is_expected(found.trajectory, SECONDS)


def test_a_file_of_vins_fusion_in_simulated_time(write):
    stamps_ns = [50_000_000 * k for k in range(4)]
    found = read_trajectory_file(write(cells(stamps_ns, [], "pwxyz", ",", ["0.1", "0.2", "0.3", ""])))
    is_expected(found.trajectory, [ns / 10**9 for ns in stamps_ns])


def test_text_of_powershell(tmp_path):
    (tmp_path / "a.txt").write_bytes(("# from a window\r\n" + rows(STAMPS, "pxyzw", "\t")).encode("utf-16"))
    is_expected(read_trajectory_file(tmp_path / "a.txt").trajectory, SECONDS)


def test_nanoseconds_by_magnitude_are_said(write):
    notes = read_trajectory_file(write(rows([f"{ns}.000000" for ns in NS], "pxyzw", " "))).trajectory.notes
    assert "nanoseconds" in notes[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (rows(STAMPS, "pxyzw", " ", [1.0]), ["9 numbers", "# timestamp tx ty tz qx qy qz qw"]),
        (rows(STAMPS, "pxyzw", ",", [1.0, 2.0, 3.0]), ["11 numbers", "names of its columns"]),
        ("# t x y z qx qy qz qw\n" + rows(STAMPS, "pxyzw", " ", [1.0]), ["line 2", "9", "header names 8"]),
        ("t,x,y,z,qx,qy,qz,qw,id\n" + rows(STAMPS, "pxyzw", ","), None),
        ("t,x,y,z,qx,qy,qz,qw,id\n" + cells(STAMPS, [], "pxyzw", ",", ["1", "2"]), ["10 numbers"]),
        ("t,x,y,z,qw,qx,qx,qy,qz\n" + cells(STAMPS, [], "pxyzw", ",", ["1"]), ["9 numbers"]),
        ("t,x,y,z,qx,qy,qz,qw,id\n" + rows(STAMPS, "pxy", ","), ["line 2", "6 numbers", "header names 9"]),
        ("t;x;y;z;qx;qy;qz;qw\n" + rows(STAMPS, "pxyzw", ";").replace(".", ","), ["line 2", "is not a number"]),
        ("VERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\n", ["graph", "with their time stamps"]),
    ],
)
def test_what_is_ambiguous_is_refused_with_what_to_add(write, refused, text, words):
    if words is None:
        is_expected(read_trajectory_file(write(text)).trajectory, SECONDS)
        return
    line = refused(text)
    assert all(word in line for word in words), line


def test_the_rotation_of_openvins_is_that_of_the_imu_in_the_world(write):
    """OpenVINS writes JPL's quaternion of world to IMU; C(q) is equation 62 of Trawny and Roumeliotis."""
    w, *of = QUATS[0]
    x, y, z = of
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    imu_from_world = (2 * w * w - 1) * np.eye(3) - 2 * w * cross + 2 * np.outer(of, of)
    found = read_trajectory_file(write(state_estimate())).trajectory
    np.testing.assert_allclose(found.c2w[0, :3, :3], imu_from_world.T, atol=1e-14)
