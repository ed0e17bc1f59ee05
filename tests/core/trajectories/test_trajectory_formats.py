# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats told apart by content, against files written by hand and a quaternion's matrix worked out here."""

import numpy as np
from cases import cases
from pose_texts import EUROC_HEADER, NS, QUATS, blocks, expected, is_expected, rows
from refusals import refused

from noisy_world.core.trajectory import Trajectory
from noisy_world.trajectories.formats import read_trajectory, read_trajectory_file
from noisy_world.trajectories.stamped_poses import tum_text

# --- EuRoC ---


@cases("header", ["", EUROC_HEADER + "\n", "#timestamp [ns],whatever\n", "a,b,c\n"])
@cases("more", [(), tuple(np.linspace(-1, 1, 9).tolist())])
def test_euroc_ground_truth(write, header, more):
    file = write(header + rows(NS, more=more), "data.csv")
    assert read_trajectory_file(file).format == "euroc"
    assert is_expected(read_trajectory(file), [ns / 10**9 for ns in NS])


def test_euroc_is_not_read_as_tum(write):
    """The trap: as TUM, w first would be x, which is another rotation of the same length."""
    wrong = expected(np.roll(QUATS, 1, axis=1))
    found = read_trajectory(write(rows(NS)))
    assert np.abs(found.c2w - wrong).max() > 0.1
    assert is_expected(found)


def test_euroc_of_any_magnitude(write):
    for start in (0, 50_000_000, 10**12, 2**62):
        stamps = [start + 50_000_000 * i for i in range(4)]
        assert is_expected(read_trajectory(write(rows(stamps))), [stamp / 10**9 for stamp in stamps])


def test_commas_with_fractional_seconds_stay_tum(write):
    stamps = ["0.0", "0.05", "0.1", "0.15"]
    file = write(rows(stamps, "pxyzw"))
    assert read_trajectory_file(file).format == "tum"
    assert is_expected(read_trajectory(file), [0.0, 0.05, 0.1, 0.15])


@cases(
    ("header", "order"),
    [
        ("#timestamp,tx,ty,tz,qx,qy,qz,qw", "pxyzw"),
        ("timestamp,x,y,z,qx,qy,qz,qw", "pxyzw"),
        ("timestamp,p_x [m],p_y [m],p_z [m],q_x,q_y,q_z,q_w", "pxyzw"),
        ("# timestamp,q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m]", "wxyzp"),
        ("stamp, pose.position.x, pose.position.y, pose.position.z, pose.orientation.x, pose.orientation.y, "
         "pose.orientation.z, pose.orientation.w", "pxyzw"),
        ("Time,TX,TY,TZ,QW,QX,QY,QZ", "pwxyz"),
        ("t,a,b,c,qw,qx,qy,qz", "pwxyz"),
    ],
)  # fmt: skip
def test_a_header_decides_the_order(write, header, order):
    text = f"# first\n{header}\n" + rows([0.0, 0.05, 0.1, 0.15], order)
    assert is_expected(read_trajectory(write(text)), [0.0, 0.05, 0.1, 0.15])
    if "," in header and "[m]" not in header and ", " not in header:
        blank = text.replace(",", " ")
        assert is_expected(read_trajectory(write(blank)), [0.0, 0.05, 0.1, 0.15])


@cases(
    ("named", "stamps", "stamps_s"),
    [
        ("timestamp [ns]", [0, 50, 100, 150], [0.0, 5e-8, 1e-7, 1.5e-7]),
        ("timestamp [s]", [10, 20, 30, 40], [10.0, 20.0, 30.0, 40.0]),
        ("timestamp_ms", [10, 20, 30, 40], [0.01, 0.02, 0.03, 0.04]),
        ("time (us)", [10, 20, 30, 40], [1e-5, 2e-5, 3e-5, 4e-5]),
        ("t_s", ["1.5", "2.5", "3.5", "4.5"], [1.5, 2.5, 3.5, 4.5]),
        ("timestamp", ["1.5", "2.5", "3.5", "4.5"], [1.5, 2.5, 3.5, 4.5]),
    ],
)
def test_a_header_decides_the_unit(write, named, stamps, stamps_s):
    file = write(f"#{named},px,py,pz,qw,qx,qy,qz\n" + rows(stamps))
    assert is_expected(read_trajectory(file), stamps_s)


def test_whole_numbers_that_are_no_nanoseconds(refused, write):
    # With commas they would be EuRoC's, a nanosecond apart.
    assert "too close for EuRoC's nanoseconds; say what they are: format: tum" in refused(rows([0, 1, 2, 3], "pxyzw"))
    assert "too close" in refused(rows([1403636579763 + 50 * i for i in range(4)]))
    file = write(rows([0, 1, 2, 3], "pxyzw"))
    assert is_expected(read_trajectory(file, format="tum"), [0.0, 1.0, 2.0, 3.0])
    file = write(rows([0, 50, 100, 150]))
    assert is_expected(read_trajectory(file, stamp_unit="ms"), [0.0, 0.05, 0.1, 0.15])


@cases("rows", [3, 4])
def test_a_number_or_a_stamp_before_a_matrix(write, refused, rows):
    """As KITTI-360's poses.txt (3 x 4) and cam0_to_world.txt (4 x 4), whose first frames have no pose."""
    matrix = np.eye(4)
    matrix[:3, 3] = 1, 2, 3
    for firsts, times_s in (((1, 2, 5), (0.1, 0.2, 0.5)), ((0.5, 0.75, 1.5), (0.5, 0.75, 1.5))):
        text = "".join(" ".join(map(repr, [first, *matrix[:rows].ravel().tolist()])) + "\n" for first in firsts)
        found = read_trajectory_file(write(text), rate_hz=10.0)
        assert found.format == "kitti360"
        np.testing.assert_allclose(found.trajectory.stamps_s, times_s, rtol=1e-15)
        np.testing.assert_array_equal(found.trajectory.c2w, [matrix] * 3)
        again = text.replace(f"{firsts[1]!r} ", f"{firsts[0]!r} ", 1)
        assert f"line 2: its number {firsts[0]} does not come after" in refused(again)


# --- units of stamps ---


def test_tum_in_nanoseconds(write):
    """As ORB-SLAM3's SaveTrajectoryEuRoC writes it; exact to the nearest float64."""
    file = write(rows([f"{ns}.000000" for ns in NS], "pxyzw", " "))
    assert read_trajectory_file(file).format == "tum"
    assert is_expected(read_trajectory(file), [ns / 10**9 for ns in NS])
    file = write(rows(NS, "pxyzw", " "))
    assert is_expected(read_trajectory(file), [ns / 10**9 for ns in NS])
    file = write(rows([f"{ns / 1e18!r}e18" for ns in NS], "pxyzw", " "))
    np.testing.assert_allclose(read_trajectory(file).stamps_s, np.array(NS) / 1e9, rtol=0, atol=1e-6)


def test_nanoseconds_with_commas_and_a_point_are_unclear(refused, write):
    text = rows([f"{ns}.000000" for ns in NS])
    assert "may be EuRoC's columns or TUM's; say which: format" in refused(text)
    assert is_expected(read_trajectory(write(text), format="euroc", stamp_unit="ns"), [ns / 10**9 for ns in NS])


@cases(
    ("unit", "factor"),
    [("ms", 10**3), ("us", 10**6)],
)
def test_stamps_that_are_no_seconds(refused, write, unit, factor):
    stamps = [1403636579 * factor + factor // 20 * i for i in range(4)]
    text = rows(stamps, "pxyzw", " ")
    message = refused(text)
    assert message.startswith(f"line 1: the time stamp {stamps[0]} s is more than 1e11 s, over 3,000 years")
    assert "stamp_unit: ms, us or ns" in message
    seconds = [stamp / factor for stamp in stamps]
    assert is_expected(read_trajectory(write(text), stamp_unit=unit), seconds)
    assert is_expected(read_trajectory(write(text), stamp_unit=unit, format="tum"), seconds)


def test_relative_stamps_that_are_no_seconds(refused, write):
    text = rows([0, 50_000_000, 100_000_000, 150_000_000], "pxyzw", " ")
    assert "whole-numbered stamps are 5e+07 apart, which would be 579 days; say their unit" in refused(text)
    assert is_expected(read_trajectory(write(text), stamp_unit="ns"), [0.0, 0.05, 0.1, 0.15])
    daily = rows([86_400 * i for i in range(4)], "pxyzw", " ")  # a time lapse
    assert is_expected(read_trajectory(write(daily)))
    assert is_expected(read_trajectory(write(text), stamp_unit="s"), [0.0, 5e7, 1e8, 1.5e8])


def test_a_unit_without_stamps_is_refused(refused):
    text = "1 0 0 0 0 1 0 0 0 0 1 0\n"
    assert "has no time stamps (kitti), so none in ms; leave stamp_unit out" in refused(text, stamp_unit="ms")


def test_nanoseconds_that_float64_cannot_tell_apart(refused):
    assert "does not come after" in refused(rows([NS[0], NS[0] + 1, NS[0] + 2, NS[0] + 3]), stamp_unit="ns")


# --- declared formats ---


@cases(
    ("declared", "content", "says"),
    [
        ("tum", "1 0 0 0 0 1 0 0 0 0 1 0\n", "line 1: 12 numbers; a TUM line"),
        ("replica", rows(NS), "line 1: 8 numbers"),
        ("kitti", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n", "line 1: 16 numbers"),
        ("euroc", rows(["0.5", "1.5", "2.5", "3.5"]), "line 1: '0.5' is no time in whole nanoseconds; stamp_unit"),
        ("tum", "#t,px,py,pz,qw,qx,qy,qz\n" + rows([0, 1, 2, 3]), "the header names the quaternion's w first"),
        ("log", "".join(blocks()), "line 1: 4 numbers; a .log"),
        ("matrices", rows(NS), "line 1: 8 numbers; a pose is four lines"),
        ("transforms", rows(NS), "line 1: is not valid JSON"),
    ],
)
def test_a_declared_format_that_it_cannot_be(refused, declared, content, says):
    assert says in refused(content, format=declared)


def test_a_declared_format_that_content_cannot_tell(write):
    whole = write(rows([0, 10**9, 2 * 10**9, 3 * 10**9], "pxyzw"))
    assert is_expected(read_trajectory(whole, format="tum", stamp_unit="ns"), [0.0, 1.0, 2.0, 3.0])
    blank = write(rows(NS, separator=" "))
    assert is_expected(read_trajectory(blank, format="euroc"), [ns / 10**9 for ns in NS])


@cases("wrong", [{"format": "csv"}, {"stamp_unit": "h"}, {"direction": "up"}, {"axes": "blender"}])
def test_arguments_that_do_not_exist(write, wrong):
    refused(read_trajectory, write(rows(NS)), **wrong, names="is auto or one of", error=ValueError)


# --- what is kept ---


def test_notes_stay_with_a_path_that_is_selected():
    from noisy_world.core.trajectory import resample, subsample

    path = Trajectory(np.tile(np.eye(4), (3, 1, 1)), [0.0, 1.0, 2.0], ("said",))
    assert subsample(path, 1).notes == resample(path, 2.0).notes == ("said",)


def test_our_own_text_is_read_back_as_tum(write):
    path = Trajectory(expected(), [0, 1, 2, 3])
    assert is_expected(read_trajectory(write(tum_text(path))), [0.0, 1.0, 2.0, 3.0])
