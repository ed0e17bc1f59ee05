# SPDX-License-Identifier: GPL-3.0-or-later
"""Poses as matrices: blocks, folders, .log and transforms.json, against files written by hand."""

import json
import math
from dataclasses import replace

import numpy as np
from cases import cases
from pose_texts import NS, blocks, expected, is_expected
from refusals import refused

from noisy_world.core.geometry import Intrinsics
from noisy_world.trajectories.formats import DOOR, TRAJECTORY_FORMATS, read_trajectory, read_trajectory_file

# --- four lines a pose ---


def test_blocks_in_one_file(write):
    file = write("\n".join(blocks()))
    assert read_trajectory_file(file).format == "matrices"
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
    assert read_trajectory_file(folder).format == "matrices"
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
    refused(read_trajectory, tmp_path / "pose", names=("0.txt: line 1: 7 of 7 ", "no pose is left"))


def test_folders_that_are_no_path(write, tmp_path):
    def says(folder, *names, **how):
        refused(read_trajectory, tmp_path / folder, **how, names=(folder, *names))

    write(blocks()[0], "two/0.txt")
    write(blocks()[0], "two/frame1.txt")
    says("two", "0.txt and frame1.txt")
    write(blocks()[0], "same/1.txt")
    write(blocks()[0], "same/01.txt")
    says("same", "01.txt and 1.txt")
    write("readme", "none/readme.txt")
    says("none", "without numbered .txt files")
    write(blocks()[0], "short/0.txt")
    write("1 0 0 0\n0 1 0 0\n", "short/1.txt")
    says("short", "1.txt: line 2: 2 lines", "four lines of four")
    write(blocks()[0], "wide/0.txt")
    write("1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n", "wide/1.txt")
    says("wide", "1.txt: line 2: 3 numbers")
    says("wide", "a folder", "tum", format="tum")
    for ns in NS:
        write(blocks()[0], f"stamps/{ns}.txt")
    says("stamps", "at 20 Hz", "raise rate_hz", "number the files from 0")
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
    assert read_trajectory_file(file).format == "log"
    assert is_expected(read_trajectory(file, rate_hz=10.0), [0.0, 0.1, 0.2, 0.5])
    later = file.read_text().replace("0 0 1\n", "0 0 5\n", 1).replace("1 1 2\n", "1 1 6\n", 1)
    later = later.replace("2 2 3\n", "2 2 8\n", 1).replace("3 3 6\n", "3 3 9\n", 1)  # it begins with its fifth frame
    assert is_expected(read_trajectory(write(later, "later.log"), rate_hz=10.0), [0.4, 0.5, 0.7, 0.8])
    zeros = "".join(f"{i} {i} 0\n{block}" for i, block in enumerate(blocks()))  # Tanks and Temples
    assert is_expected(read_trajectory(write(zeros), rate_hz=10.0), np.arange(4) / 10.0)


def test_logs_that_are_no_path(refused):
    text = "".join(f"{i} {i} {i + 1}\n{block}" for i, block in enumerate(blocks()))
    pairs = "".join(f"{i} {i + 2} 57\n{block}" for i, block in enumerate(blocks()))
    assert refused(pairs).startswith("line 1: aligns two fragments (0 2 57); this is no path")
    assert refused(text[: text.rindex("\n", 0, -1)]).startswith("line 19: 4 numbers, and the pose is not complete")
    assert refused(text.replace("2 2 3\n", "")).startswith("line 11: 4 numbers; a .log")
    assert refused(text.replace("2 2 3", "2 2.5 3")).startswith("line 11: 2 2.5 3; a .log")
    assert refused(text.replace("2 2 3", "2 2 1e300")).startswith("line 11: 2 2 1e+300; a .log")


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


def test_the_camera_of_transforms_json_counts_from_the_middle_of_a_pixel(write):
    # nerfstudio's rays go through half-numbered pixels: the middle of 640 pixels is 320 there, and 319.5 here.
    stated = transforms(w=640, h=480, fl_x=500, fl_y=501, cx=320, cy=240)
    camera = read_trajectory_file(write(json.dumps(stated))).camera
    assert (camera.width_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == (640, 500, 501, 319.5, 239.5)


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


# --- Open3D's JSON, transforms.json and COLMAP's images ---


def test_json_of_open3d_that_holds_no_path(refused):
    assert refused('{"class_name": "PinholeCameraIntrinsic"}', format="open3d").startswith("class_name: is ")
    told = refused('{"class_name": "PinholeCameraTrajectory", "parameters": []}', format="open3d")
    assert told.startswith("parameters: holds no pose; a list of objects with extrinsic, 16 numbers each")
    told = refused('{"class_name": "PoseGraph", "nodes": 3}', format="open3d")
    assert told.startswith("nodes: holds no pose; a list of objects with pose")


def test_names_without_numbers_tell_no_order(write):
    unit = np.eye(4).tolist()

    def notes(*names):
        frames = [{"file_path": name, "transform_matrix": unit} for name in names]
        return read_trajectory(write(json.dumps({"frames": frames}), "transforms.json")).notes

    assert notes("hall.png", "door.png") == ()
    assert notes("1.png", "door.png") == ()
    assert "(1.png comes after 2.png)" in " ".join(notes("2.png", "1.png"))


def test_images_of_colmap_that_hold_no_pose(refused):
    assert refused("# IMAGE_ID, QW\n", format="colmap").startswith("holds no pose; a reconstruction of one image")
    told = refused("# IMAGE_ID\n1 1 0 0 zero 0 0 0 1 a.png\n\n", format="colmap")
    assert told.startswith("line 2: holds a pose that is no numbers")


def test_empty_lines_before_the_images_of_colmap_are_no_images(write):
    lines = ["# IMAGE_ID", "", " ", "1 1 0 0 0 -1 -2 -3 1 a.png", "", "2 1 0 0 0 -4 -5 -6 1 b.png", "", ""]
    found = read_trajectory(write("\n".join(lines)), format="colmap")
    assert found.c2w[:, :3, 3].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_numbers_that_no_seconds_can_tell_apart(refused):
    first = 9 * 10**15
    text = "".join(f"{first + n} {first + n} {first + n + 1}\n{block}" for n, block in enumerate(blocks()))
    told = refused(text, format="log", rate_hz=1e6)
    assert "too closely for float64 seconds" in told
    assert "number them from 0" in told


def test_what_a_format_does_not_say_of_itself():
    known = TRAJECTORY_FORMATS["tum"]
    assert DOOR.problem(known) == ""
    assert DOOR.problem(replace(known, label="", meaning="")) == "its trajectory format lacks label, meaning"
    for name in ("auto", "My Format", "9lives"):
        assert DOOR.problem(replace(known, name=name)).startswith(f"{name!r} is no name of a format")
