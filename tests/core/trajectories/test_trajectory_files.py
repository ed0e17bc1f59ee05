# SPDX-License-Identifier: GPL-3.0-or-later
from pathlib import Path

import numpy as np
import pytest
import refusals
from calls import calls_made
from cases import cases
from pose_texts import kitti_text

from noisy_world.core.errors import InputError
from noisy_world.core.geometry import (
    pose,
    quat_wxyz_from_rotation,
    rotation_angle_rad,
    rotation_error,
    rotation_from_euler_deg,
)
from noisy_world.core.trajectory import Trajectory, evenly_stamped, subsample
from noisy_world.trajectories.formats import read_trajectory, read_trajectory_file
from noisy_world.trajectories.matrix_poses import replica_text
from noisy_world.trajectories.stamped_poses import tum_text

REAL_ROOM = Path(__file__).parents[4] / "shared/data/real_room"

IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n"
TUM_LINE = "0.5 1 2 3 0 0 0 1\n"


def path_of(count, seed=0):
    rng = np.random.default_rng(seed)
    rotation = rotation_from_euler_deg(*rng.uniform(-180, 180, (3, count)))
    return evenly_stamped(pose(rotation, rng.normal(size=(count, 3))))


def test_replica_line_by_hand(write):
    # Looking along world +y from (1, 2, 3); the numbers are row-major, the translation 4th, 8th and 12th.
    trajectory = read_trajectory(write("1 0 0 1 0 0 1 2 0 -1 0 3 0 0 0 1\n"))
    np.testing.assert_array_equal(trajectory.c2w, [[[1, 0, 0, 1], [0, 0, 1, 2], [0, -1, 0, 3], [0, 0, 0, 1]]])
    np.testing.assert_array_equal(trajectory.stamps_s, [0.0])


def test_tum_line_by_hand(write):
    # Half a turn about x: the quaternion's x is the fifth number, its w the last.
    trajectory = read_trajectory(write("1305031102.175304 1.3405 0.6266 1.6575 1 0 0 0\n"))
    np.testing.assert_array_equal(trajectory.c2w[0, :3, :3], np.diag([1, -1, -1]))
    np.testing.assert_array_equal(trajectory.c2w[0, :3, 3], [1.3405, 0.6266, 1.6575])
    assert trajectory.stamps_s[0] == 1305031102.175304
    quarter = read_trajectory(write("0 0 0 0 0 0 0.7071067811865476 0.7071067811865476"))
    np.testing.assert_allclose(quarter.c2w[0, :3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


def test_kitti_and_replica_of_the_same_poses_are_equal(write):
    trajectory = path_of(50)
    kitti = read_trajectory(write(kitti_text(trajectory)))
    replica = read_trajectory(write(replica_text(trajectory)))
    np.testing.assert_array_equal(kitti.c2w, replica.c2w)
    np.testing.assert_array_equal(kitti.c2w, trajectory.c2w)
    np.testing.assert_array_equal(kitti.stamps_s, trajectory.stamps_s)


@cases(("writer", "name"), [(replica_text, "replica"), (kitti_text, "kitti"), (tum_text, "tum")])
def test_format_is_told_by_content(write, writer, name):
    # The names lie.
    for file_name in ("traj.txt", "groundtruth.txt", "00.csv"):
        assert read_trajectory_file(write(writer(path_of(3)), file_name)).format == name


def test_tum_round_trip(write):
    trajectory = Trajectory(path_of(200).c2w, 1.6e9 + np.arange(200) / 7)
    back = read_trajectory(write(tum_text(trajectory)))
    np.testing.assert_array_equal(back.stamps_s, trajectory.stamps_s)
    np.testing.assert_array_equal(back.c2w[:, :3, 3], trajectory.c2w[:, :3, 3])
    assert rotation_angle_rad(back.c2w[:, :3, :3], trajectory.c2w[:, :3, :3]).max() < 2e-15


def test_tum_quaternions_are_continuous_and_unit():
    turning = evenly_stamped(pose(rotation_from_euler_deg(0.0, np.arange(0.0, 1000, 5), 0.0), np.zeros(3)))
    rows = np.array([list(map(float, line.split())) for line in tum_text(turning).splitlines()])
    canonical = quat_wxyz_from_rotation(turning.c2w[:, :3, :3])
    assert (np.sum(canonical[1:] * canonical[:-1], axis=1) < 0).any()  # the case exists
    assert (np.sum(rows[1:, 4:] * rows[:-1, 4:], axis=1) > 0.99).all()
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-15)


def test_written_text():
    c2w = pose(np.diag([1.0, -1.0, -1.0]), [0.1, -0.0, 1e-7])
    trajectory = Trajectory(c2w[None], [0.05])
    assert replica_text(trajectory) == ("1.0 0.0 0.0 0.1 0.0 -1.0 0.0 0.0 0.0 0.0 -1.0 1e-07 0.0 0.0 0.0 1.0\n")
    assert tum_text(trajectory) == "0.05 0.1 0.0 1e-07 1.0 0.0 0.0 0.0\n"


def test_blank_lines_comments_line_ends_and_marks(write):
    plain = read_trajectory(write(replica_text(path_of(3))))
    lines = replica_text(path_of(3)).splitlines()
    decorated = [
        "\n# a comment, with é\n\n" + "\n".join(lines) + "\n\n   \n# end",
        "\r\n".join(lines) + "\r\n",
        "\r".join(lines),
        "\ufeff" + "\n".join(lines),
        "\n".join("  " + line.replace(" ", "\t ") + " # frame" for line in lines),
        "\n".join(line.replace(" ", ",") for line in lines),
        "\n".join(line.replace(" ", ", ") + "," for line in lines),
    ]
    for text in decorated:
        np.testing.assert_array_equal(read_trajectory(write(text)).c2w, plain.c2w)


def test_rate_and_conventions_are_applied(write):
    file = write("1 0 0 1 0 0 -1 2 0 1 0 3 0 0 0 1\n" * 2)  # Blender's axes, looking along world +y
    trajectory = read_trajectory(file, axes="opengl", rate_hz=30.0)
    np.testing.assert_array_equal(trajectory.c2w[1], [[1, 0, 0, 1], [0, 0, 1, 2], [0, -1, 0, 3], [0, 0, 0, 1]])
    np.testing.assert_array_equal(trajectory.stamps_s, [0.0, 1 / 30])
    w2c = read_trajectory(file, direction="w2c")
    np.testing.assert_allclose(w2c.c2w[0] @ [[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 3], [0, 0, 0, 1]], np.eye(4))
    # The stamps of a TUM file are its own, whatever the rate.
    tum = read_trajectory(write(TUM_LINE + TUM_LINE.replace("0.5", "0.75")), direction="w2c", axes="robot", rate_hz=1.0)
    np.testing.assert_array_equal(tum.stamps_s, [0.5, 0.75])
    np.testing.assert_array_equal(tum.c2w[0, :3, 3], [-1, -2, -3])


@cases("wrong", [{"axes": "blender"}, {"direction": "up"}, {"rate_hz": 0.0}])
def test_arguments_that_do_not_exist(write, wrong):
    with pytest.raises(ValueError, match=r"one of|hertz"):
        read_trajectory(write(IDENTITY), **wrong)


def test_rounded_rotations_are_made_orthonormal(write):
    exact = path_of(100)
    for digits in (3, 6, 9):
        text = "".join(" ".join(f"{v:.{digits}f}" for v in row) + "\n" for row in exact.c2w.reshape(-1, 16))
        back = read_trajectory(write(text))
        assert rotation_error(back.c2w[:, :3, :3]).max() < 2e-15
        assert rotation_angle_rad(back.c2w[:, :3, :3], exact.c2w[:, :3, :3]).max() < 3 * 10.0**-digits
    tum = read_trajectory(write("0 1 2 3 0 0 0.709 0.709\n"))
    np.testing.assert_allclose(tum.c2w[0, :3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


def test_exact_rotations_stay_bit_for_bit(write):
    exact = path_of(300, seed=4)
    assert rotation_error(exact.c2w[:, :3, :3]).max() > 0.0
    np.testing.assert_array_equal(read_trajectory(write(replica_text(exact))).c2w, exact.c2w)


def test_wrong_numbers_on_a_line(refused):
    assert "16 numbers (Replica), 12 (KITTI) or 8 (TUM)" in refused("1 2 3\n")
    assert refused("1 0 0\n" * 4).startswith("line 1: 3 numbers; a line holds one pose")
    message = refused(f"# head\n{IDENTITY}\n{IDENTITY}{IDENTITY[:-3]}\n")
    assert message.startswith("line 5: 15 numbers, but line 2 has 16")
    assert refused(IDENTITY + TUM_LINE).startswith("line 2: 8 numbers, but line 1 has 16")
    assert refused(IDENTITY * 3 + IDENTITY.replace("\n", " ") + IDENTITY).startswith("line 4: 32 numbers")


@cases(
    ("token", "shown"),
    [("x", "'x'"), ("0x10", "'0x10'"), ("1_0", "'1_0'"), ("٣", "'٣'"), ("1.0f", "'1.0f'"), ("--1", "'--1'")],
)
def test_tokens_that_are_no_numbers(refused, token, shown):
    assert refused(IDENTITY + IDENTITY.replace("1", token, 1)).startswith(f"line 2: {shown} is not a number")


def test_endless_words_are_cut(refused):
    for text in (
        "9" * 5000 + "x 1 2",
        TUM_LINE + "1" * 300 + "x 0 0 0 0 0 0 1\n",
        "".join("0." + "0" * 900 + f"{digit} 0 0 0 0 0 0 1\n" for digit in (2, 1)),
    ):
        assert len(refused(text)) < 300
    assert len(refused("9" * 250 + " 0 0 0 0 0 0 1\n")) < 300


def test_headers_and_commas(refused, write):
    headed = read_trajectory(write("timestamp tx ty tz qx qy qz qw\n" + TUM_LINE))
    np.testing.assert_array_equal(headed.c2w, read_trajectory(write(TUM_LINE)).c2w)
    assert refused(TUM_LINE + "timestamp tx ty tz qx qy qz qw\n").startswith("line 2: 'timestamp' is not a number")
    assert refused("one\ntwo\n" + TUM_LINE).startswith("line 2: 'two' is not a number")
    assert refused("0.5 x 2 3 0 0 0 1\n").startswith("line 1: 'x' is not a number")
    assert refused("timestamp tx ty tz qx qy qz qw\n").startswith("holds no pose")
    # A decimal comma would make 16 numbers of a TUM line.
    assert "is not a number" in refused("0,5 1,5 2,5 3,5 0,0 0,0 0,0 1,0\n")
    assert "'' is not a number" in refused("0.5,1,2,3,,0,0,0,1\n")


@cases("token", ["nan", "inf", "-inf", "1e999"])
def test_numbers_that_are_not_finite(refused, token):
    message = refused(f"{IDENTITY}\n1 0 0 {token} 0 1 0 0 0 0 1 0 0 0 0 1\n")
    assert message.startswith(f"line 3: holds {float(token)}")
    assert refused(TUM_LINE.replace("0.5", token)).startswith("line 1: holds ")


def test_last_row(refused, write):
    # A column-major file has its translation there.
    assert refused(IDENTITY + "1 0 0 0 0 1 0 0 0 0 1 0 5 6 7 1\n").startswith(
        "line 2: the last row of the pose is 5 6 7 1, not 0 0 0 1"
    )
    assert "last row" in refused("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1.00001\n")
    nearly = read_trajectory(write("1 0 0 0 0 1 0 0 0 0 1 0 0 0 1e-7 1.0000001\n"))
    np.testing.assert_array_equal(nearly.c2w[0], np.eye(4))


def test_rotations_that_are_none(refused, write):
    scaled = "1.1 0 0 0 0 1.1 0 0 0 0 1.1 0"
    message = refused(IDENTITY * 16 + scaled + " 0 0 0 1\n")
    assert message.startswith("line 17: ")
    assert "off by 0.21" in message
    assert refused(scaled).startswith("line 1: ")
    assert "no rotation" in refused("0 0 0 0 0 0 0 0 0 0 0 0")
    assert "no rotation" in refused("1e200 0 0 0 0 1 0 0 0 0 1 0")
    assert "no rotation" in refused("1.003 0 0 0 0 1 0 0 0 0 1 0")  # 6e-3 off
    read_trajectory(write("1.002 0 0 0 0 1 0 0 0 0 1 0"))  # 4e-3 off


def test_mirrored_poses(refused):
    message = refused(IDENTITY + "1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1\n")
    assert message.startswith("line 2: the pose mirrors (determinant -1)")
    assert "declare their axes" in message


def test_quaternions_that_are_none(refused, write):
    assert refused("0 1 2 3 0 0 0 0\n").startswith("line 1: the quaternion has length 0, not 1")
    assert "length 1.02" in refused("0 1 2 3 0 0 1.02 0\n")
    assert "length 0.98" in refused("0 1 2 3 0 0 0 -0.98\n")
    assert "length" in refused("0 1 2 3 0 0 0 1e300\n")
    read_trajectory(write("0 1 2 3 0 0 0 1.009\n"))


def test_stamps_that_go_back(refused):
    lines = "".join(f"{stamp} 1 2 3 0 0 0 1\n" for stamp in (0.1, 0.2, 0.15, 0.3))
    assert refused(lines).startswith("line 3: the time stamp 0.15 does not come after")
    assert "line 2" in refused("1 0 0 0 0 0 0 1\n0.5 0 0 0 0 0 0 1\n")


def test_of_poses_with_one_stamp_the_first_is_kept_with_a_note(write):
    text = "".join(f"{stamp} {place} 2 3 0 0 0 1\n" for place, stamp in enumerate(["0.1", "0.2", "0.20", "0.2", "0.3"]))
    found = read_trajectory(write(text))
    assert found.stamps_s.tolist() == [0.1, 0.2, 0.3]
    assert found.c2w[:, 0, 3].tolist() == [0, 1, 4]
    assert "2 poses" in found.notes[0]
    assert "line 3" in found.notes[0]


@cases("content", ["", "\n\n", "# only a comment\n", "\ufeff"])
def test_empty_files(refused, content):
    assert "no pose" in refused(content)


@cases("content", [b"\x89PNG\r\n\x1a\n\x00", b"1 0 0\xff\xfe", IDENTITY.encode("utf-16-le"), b"1 2 \x00 3"])
def test_files_that_are_no_text(refused, content):
    assert "not a text file" in refused(content)


def test_files_that_are_not_there(tmp_path):
    for path, says in (
        (tmp_path / "no.txt", "does not exist"),
        (tmp_path, "without numbered .txt files"),
        (tmp_path / "no/a.txt", "exist"),
    ):
        for read in (read_trajectory, read_trajectory_file):
            refusals.refused(read, path, names=(str(path), says))


def test_errors_hold_their_parts(write):
    with pytest.raises(InputError) as error:
        read_trajectory(str(write(IDENTITY + "1 2 3\n")))
    assert error.value.where == "line 2"
    assert str(error.value.remedy)


def test_one_pose(write):
    one = subsample(path_of(1), stop=1)
    for writer in (replica_text, kitti_text, tum_text):
        back = read_trajectory(write(writer(one)))
        np.testing.assert_allclose(back.c2w, one.c2w, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(back.stamps_s, [0.0])


def test_far_from_the_origin_nothing_is_lost(write):
    far = evenly_stamped(path_of(20).c2w + pose(np.zeros((3, 3)), [1e5, -1e5, 1e5]) * [[1], [1], [1], [0]])
    for writer in (replica_text, kitti_text, tum_text):
        np.testing.assert_array_equal(read_trajectory(write(writer(far))).c2w[:, :3, 3], far.c2w[:, :3, 3])


def test_a_pose_costs_few_calls(write):
    """Numbers are read a line at a time, not one by one, and twice as many lines cost twice as much."""
    few, many = (calls_made(read_trajectory, write(replica_text(path_of(count)))) for count in (100, 1000))
    assert (many - few) / 900 < 12


@pytest.mark.skipif(not REAL_ROOM.is_dir(), reason="the real room's poses (../shared/data/real_room) are not here")
def test_real_replica_and_tum_files_hold_the_same_poses():
    replica = read_trajectory(REAL_ROOM / "traj.txt", rate_hz=30.0)
    tum = read_trajectory(REAL_ROOM / "traj_tum.txt")
    assert len(replica) == len(tum) == 1000
    np.testing.assert_allclose(tum.c2w, replica.c2w, rtol=0, atol=1e-6)
    np.testing.assert_allclose(tum.stamps_s, replica.stamps_s, rtol=0, atol=1e-6)
    assert rotation_error(replica.c2w[:, :3, :3]).max() < 2e-15
