# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats told apart by content, against files written by hand and a quaternion's matrix worked out here."""

import json
import math

import numpy as np
import pytest
from cases import cases

from noisy_world.core.errors import InputError
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.trajectories.files import detect_format, read_trajectory, read_trajectory_file, tum_text
from noisy_world.core.trajectories.trajectory import Trajectory

# Four poses: position, then the quaternion w, x, y, z, normalised.
RNG = np.random.default_rng(5)
POSITIONS = RNG.normal(size=(4, 3))
QUATS = RNG.normal(size=(4, 4))
QUATS /= np.linalg.norm(QUATS, axis=1, keepdims=True)
NS = [1403636579763555584, 1403636579813555456, 1403636579863555584, 1403636580013555456]
EUROC_HEADER = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], "
    "b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]"
)


def matrix_of(w, x, y, z):
    """v -> q v q* by Hamilton's products, column by column."""

    def product(a, b):
        real = a[0] * b[0] - a[1:] @ b[1:]
        return np.concatenate([[real], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])

    q, inverse = np.array([w, x, y, z]), np.array([w, -x, -y, -z])
    columns = [product(product(q, np.concatenate([[0.0], axis])), inverse)[1:] for axis in np.eye(3)]
    return np.array(columns).T


def expected(quats=QUATS, positions=POSITIONS):
    poses = np.tile(np.eye(4), (len(quats), 1, 1))
    poses[:, :3, :3] = [matrix_of(*quat) for quat in quats]
    poses[:, :3, 3] = positions
    return poses


def rows(stamps, order="pwxyz", separator=",", more=()):
    """Lines of stamps, positions and quaternions, in an order such as EuRoC's pwxyz or TUM's pxyzw."""
    lines = []
    for stamp, position, (w, x, y, z) in zip(stamps, POSITIONS, QUATS, strict=True):
        parts = {"p": position, "w": [w], "x": [x], "y": [y], "z": [z]}
        numbers = [repr(float(v)) for letter in order for v in parts[letter]]
        lines.append(separator.join([str(stamp), *numbers, *map(repr, more)]))
    return "\n".join(lines) + "\n"


def blocks(poses=None):
    return ["\n".join(" ".join(map(repr, row)) for row in pose.tolist()) + "\n" for pose in poses or expected()]


@pytest.fixture
def write(tmp_path):
    def write_file(content, name="poses.txt"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content)
        return file

    return write_file


@pytest.fixture
def refused(write):
    def message(content, **how):
        file = write(content)
        with pytest.raises(InputError) as error:
            read_trajectory(file, **how)
        text = str(error.value)
        assert text.startswith(f"{file}: ")
        assert "\n" not in text
        return text.removeprefix(f"{file}: ")

    return message


def is_expected(trajectory, stamps_s=None):
    np.testing.assert_allclose(trajectory.c2w, expected(), rtol=0, atol=1e-14)
    if stamps_s is not None:
        np.testing.assert_array_equal(trajectory.stamps_s, stamps_s)
    return True


# --- EuRoC ---


@cases("header", ["", EUROC_HEADER + "\n", "#timestamp [ns],whatever\n", "a,b,c\n"])
@cases("more", [(), tuple(np.linspace(-1, 1, 9).tolist())])
def test_euroc_ground_truth(write, header, more):
    file = write(header + rows(NS, more=more), "data.csv")
    assert detect_format(file) == "euroc"
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
    assert detect_format(file) == "tum"
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


def test_a_stamp_before_a_matrix_is_not_euroc(refused):
    pose = np.eye(4).ravel().tolist()
    text = "".join(" ".join(map(repr, [0.1 * i, *pose])) + "\n" for i in range(3))
    assert "a stamp before a 4 x 4 pose" in refused(text)


# --- units of stamps ---


def test_tum_in_nanoseconds(write):
    """As ORB-SLAM3's SaveTrajectoryEuRoC writes it; exact to the nearest float64."""
    file = write(rows([f"{ns}.000000" for ns in NS], "pxyzw", " "))
    assert detect_format(file) == "tum"
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
    with pytest.raises(ValueError, match="is auto or one of"):
        read_trajectory(write(rows(NS)), **wrong)


# --- four lines a pose ---


def test_blocks_in_one_file(write):
    file = write("\n".join(blocks()))
    assert detect_format(file) == "matrices"
    assert is_expected(read_trajectory(file, rate_hz=10.0), [0.0, 0.1, 0.2, 0.3])
    assert is_expected(read_trajectory(write("# poses\n" + "".join(blocks()).replace(" ", ","))))


def test_blocks_that_are_not_whole(refused):
    assert refused("".join(blocks()) + "1 0 0 0\n").startswith("line 17: 17 lines of four numbers are no whole number")
    assert refused("1 0 0 0\n0 1 0 0\n0 0 1 0\n").startswith("line 3: 3 lines of four numbers")
    assert "line 5: the last row of the pose" in refused(blocks()[0] + "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 2\n")


@cases("name", ["{}.txt", "{:06}.txt", "frame-{:06}.pose.txt", "scene0000_00_{}.txt"])
def test_a_folder_of_poses(write, tmp_path, name):
    folder = tmp_path / name.replace("{", "").replace("}", "").replace(":", "")
    for number, text in zip((0, 2, 9, 10), blocks(), strict=True):  # 10 sorts before 2 by letters
        write(text, folder.relative_to(tmp_path) / name.format(number))
    write("no pose", folder.relative_to(tmp_path) / "000009.color.png")
    assert detect_format(folder) == "matrices"
    assert is_expected(read_trajectory(folder, rate_hz=10.0), [0.0, 0.2, 0.9, 1.0])
    assert read_trajectory(folder).notes == ()


def test_lost_poses_are_left_out_and_said(write, tmp_path):
    lost = "-inf -inf -inf -inf\n" * 4
    for number, text in enumerate([blocks()[0], lost, blocks()[1], blocks()[2], lost, lost, blocks()[3]]):
        write(text, f"pose/{number}.txt")
    found = read_trajectory(tmp_path / "pose", rate_hz=10.0)
    assert is_expected(found, np.array([0, 2, 3, 6]) / 10.0)
    (note,) = found.notes
    assert note.startswith("3 of 7 poses are not finite (tracking was lost) and are left out, first 1.txt")
    one_file = read_trajectory(write("".join([blocks()[0], "nan nan nan nan\n" * 4, *blocks()[1:]])), rate_hz=10.0)
    assert is_expected(one_file, np.array([0, 2, 3, 4]) / 10.0)
    assert "1 of 5 poses" in one_file.notes[0]
    assert "line 5" in one_file.notes[0]
    for number in range(7):
        write(lost, f"pose/{number}.txt")
    with pytest.raises(InputError, match=r"0\.txt: line 1: 7 of 7 poses are not finite .*: no pose is left"):
        read_trajectory(tmp_path / "pose")


def test_folders_that_are_no_path(write, tmp_path):
    def says(folder, words, **how):
        with pytest.raises(InputError) as error:
            read_trajectory(tmp_path / folder, **how)
        assert words in str(error.value)
        assert "\n" not in str(error.value)

    write(blocks()[0], "two/0.txt")
    write(blocks()[0], "two/frame1.txt")
    says("two", "two kinds of numbered files, 0.txt and frame1.txt")
    write(blocks()[0], "same/1.txt")
    write(blocks()[0], "same/01.txt")
    says("same", "01.txt and 1.txt have one number")
    write("readme", "none/readme.txt")
    says("none", "without numbered .txt files")
    write(blocks()[0], "short/0.txt")
    write("1 0 0 0\n0 1 0 0\n", "short/1.txt")
    says("short", "1.txt: line 2: 2 lines; a pose is four lines of four numbers")
    write(blocks()[0], "wide/0.txt")
    write("1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n", "wide/1.txt")
    says("wide", "1.txt: line 2: 3 numbers; a pose")
    says("wide", "is a folder, which is not tum", format="tum")
    for ns in NS:
        write(blocks()[0], f"stamps/{ns}.txt")
    says("stamps", "over 3,000 years, at 20 Hz; raise rate_hz, or number the files from 0; numbers that are time")
    stamped = read_trajectory(tmp_path / "stamps", stamp_unit="ns")
    np.testing.assert_allclose(stamped.stamps_s, np.array(NS) / 1e9, rtol=0, atol=1e-6)
    write(blocks()[0], "noted/0.txt")
    write("about", "noted/about.txt")
    assert read_trajectory(tmp_path / "noted").notes[0].startswith("about.txt in noted not read")


# --- Open3D's .log ---


def test_a_log(write):
    # The example of redwood-data.org, frames counted from 1, and a gap.
    text = "".join(
        f"{i} {i} {third}\n{block}" for i, (third, block) in enumerate(zip((1, 2, 3, 6), blocks(), strict=True))
    )
    file = write(text, "trajectory.log")
    assert detect_format(file) == "log"
    assert is_expected(read_trajectory(file, rate_hz=10.0), [0.0, 0.1, 0.2, 0.5])
    zeros = "".join(f"{i} {i} 0\n{block}" for i, block in enumerate(blocks()))  # Tanks and Temples
    assert is_expected(read_trajectory(write(zeros), rate_hz=10.0), np.arange(4) / 10.0)


def test_logs_that_are_no_path(refused):
    text = "".join(f"{i} {i} {i + 1}\n{block}" for i, block in enumerate(blocks()))
    pairs = "".join(f"{i} {i + 2} 57\n{block}" for i, block in enumerate(blocks()))
    assert refused(pairs).startswith("line 1: aligns two fragments (0 2 57); this is no path")
    assert refused(text[: text.rindex("\n", 0, -1)]).startswith("line 19: 4 numbers, and the pose is not complete")
    assert refused(text.replace("2 2 3\n", "")).startswith("line 11: 4 numbers; a .log")
    assert refused(text.replace("2 2 3", "2 2.5 3")).startswith("line 11: 2 2.5 3; a .log")


# --- transforms.json ---


def transforms(**more):
    """Poses with OpenGL's axes, y and z of the camera the other way round."""
    poses = expected() @ np.diag([1.0, -1.0, -1.0, 1.0])
    frames = [{"file_path": f"images/frame_{i:05}.png", "transform_matrix": p.tolist()} for i, p in enumerate(poses)]
    return {"frames": frames, **more}


def test_transforms_json(write):
    file = write(json.dumps(transforms()), "transforms.json")
    found = read_trajectory_file(file, rate_hz=10.0)
    assert (found.format, found.axes, found.direction) == ("transforms", "opengl", "c2w")
    assert is_expected(found.trajectory, np.arange(4) / 10.0)
    assert found.trajectory.notes == ()
    assert found.camera is None


def test_declared_conventions_win_over_the_formats(write):
    file = write(json.dumps(transforms()), "transforms.json")
    as_opencv = read_trajectory(file, axes="opencv").c2w
    np.testing.assert_allclose(as_opencv, expected() @ np.diag([1.0, -1.0, -1.0, 1.0]), atol=1e-14)
    w2c = read_trajectory(file, direction="w2c").c2w
    np.testing.assert_allclose(w2c[0] @ np.diag([1.0, -1.0, -1.0, 1.0]) @ (expected()[0] @ np.diag([1, -1, -1, 1])),
                               np.eye(4), atol=1e-14)  # fmt: skip


def test_frames_listed_out_of_order_are_said(write):
    document = transforms()
    document["frames"][1], document["frames"][2] = document["frames"][2], document["frames"][1]
    found = read_trajectory(write(json.dumps(document)))
    np.testing.assert_allclose(found.c2w, expected()[[0, 2, 1, 3]], atol=1e-14)
    assert found.notes == (
        "frames are not listed by the numbers of their names (images/frame_00001.png comes after "
        "images/frame_00002.png): the path is as listed",
    )


def test_moved_and_scaled_worlds_are_said(write):
    moved = np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]], dtype=float).tolist()
    notes = read_trajectory(write(json.dumps(transforms(applied_transform=moved, applied_scale=0.5)))).notes
    assert "applied_transform" in notes[0]
    assert "applied_scale of 0.5" in notes[1]
    same = read_trajectory(write(json.dumps(transforms(applied_transform=np.eye(4)[:3].tolist(), applied_scale=1))))
    assert same.notes == ()


def test_the_files_camera_is_held_against_the_presets(write):
    preset = Intrinsics(640, 480, 500.0, 500.0, 319.5, 239.5)

    def difference(**more):
        camera = read_trajectory_file(write(json.dumps(transforms(**more)))).camera
        return camera.difference(preset)

    # nerfstudio counts pixels from their corners: its middle is w / 2.
    assert difference(w=640, h=480, fl_x=500.0, fl_y=500.0, cx=320.0, cy=240.0) == ""
    assert difference(camera_angle_x=2 * math.atan(320 / 500)) == ""
    assert "w" in difference(w=800, h=480, fl_x=500.0)
    said = difference(w=1920, h=480, fl_x=1500.0, fl_y=500.0, cx=320.0, cy=240.0)
    assert said == (
        "states another camera, width 1920 (the preset's: 640), fx 1500 (the preset's: 500); the preset's camera is "
        "used"
    )
    assert "a view of 90 degrees" in difference(camera_angle_x=math.pi / 2)
    assert "a lens that distorts" in difference(k1=0.1, fl_x=500.0)
    frames = transforms()["frames"]
    for index, frame in enumerate(frames):
        frame["fl_x"] = 500.0 + index
    assert "vary from frame to frame" in difference(frames=frames)


@cases(
    ("content", "says"),
    [
        ("{", "line 1: is not valid JSON"),
        ('{"frames": 5}', "frames: is no list"),
        ("{}", "frames: is missing"),
        ("[]", "is JSON, but no mapping"),
        ('{"frames": []}', "frames: is empty"),
        ('{"frames": [{}]}', "frames.0.transform_matrix: is missing"),
        ('{"frames": [5]}', "frames.0.transform_matrix: is missing"),
        ('{"frames": [{"transform_matrix": [[1, 0], [0, 1]]}]}', "frames.0.transform_matrix: is no 4 x 4"),
        (json.dumps({"frames": [{"transform_matrix": [[0] * 4] * 4}]}), "frames.0.transform_matrix: the last row"),
        (json.dumps({"frames": [{"transform_matrix": (2 * np.eye(4)[:3]).tolist()}]}), "are no rotation"),
        (json.dumps({"frames": [{"transform_matrix": [[True] * 4] * 4}]}), "holds what is no number"),
        (json.dumps({"frames": [{"transform_matrix": [[math.nan] * 4] * 4}]}), "frames.0.transform_matrix: holds nan"),
        (json.dumps({"frames": [{"transform_matrix": [[10**400] * 4] * 4}]}), "frames.0.transform_matrix: holds inf"),
        ('{"frames": [' + "9" * 5000 + "]}", "a number of too many digits"),
        ("[" * 100_000, "nested too deeply"),
        ("{" + '"a":{' * 100_000, "nested too deeply"),
        (json.dumps(transforms(fl_x="wide")), "fl_x: is 'wide', but has to be a number"),
    ],
)  # fmt: skip
def test_transforms_that_are_no_path(refused, content, says):
    assert says in refused(content)


# --- what is kept ---


def test_notes_stay_with_a_path_that_is_selected():
    from noisy_world.core.trajectories.trajectory import resample, subsample

    path = Trajectory(np.tile(np.eye(4), (3, 1, 1)), [0.0, 1.0, 2.0], ("said",))
    assert subsample(path, 1).notes == resample(path, 2.0).notes == ("said",)


def test_our_own_text_is_read_back_as_tum(write):
    path = Trajectory(expected(), [0, 1, 2, 3])
    assert is_expected(read_trajectory(write(tum_text(path))), [0.0, 1.0, 2.0, 3.0])
