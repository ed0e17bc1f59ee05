# SPDX-License-Identifier: GPL-3.0-or-later
"""Loaders of other people's systems, written anew after what these do with the files of a sequence.

Only what decides which file and which pose a frame gets is here. None of it is from Noisy World, and nothing is more
forgiving than the original: a header that they count, they count here.
"""

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Loaded:
    """What a system has of a sequence: stamps in seconds, files and camera-to-world poses; None where it reads none.

    camera: fx, fy, cx, cy in pixels whose centres are at whole coordinates.
    """

    rgb: list[Path]
    depth: list[Path] | None = None
    stamps_s: list[float] | None = None
    c2w: np.ndarray | None = None
    camera: tuple[float, float, float, float] | None = None


def pose_of(vector):
    """A pose (4, 4) of tx ty tz qx qy qz qw, as scipy's Rotation.from_quat makes it: of any length."""
    x, y, z, w = np.asarray(vector[3:7], float) / np.linalg.norm(vector[3:7])
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = vector[:3]
    return pose


# --- TUM ---


def slam_tum(folder, *, frame_rate=32.0, max_dt_s=0.08):
    """NICE-SLAM, Co-SLAM, GO-SLAM and SplaTAM, whose TUM loaders go back to one.

    Lists of images are read without, poses with a line left out at the top; each colour image takes the nearest depth
    and the nearest pose if both lie within 0.08 s; frames that follow within 1/32 s of the last one kept are left out.
    """

    def table(name, skiprows):
        return np.loadtxt(folder / name, delimiter=" ", dtype=np.str_, skiprows=skiprows)

    images, depths, poses = table("rgb.txt", 0), table("depth.txt", 0), table("groundtruth.txt", 1)
    rgb_s, depth_s, pose_s = (part[:, 0].astype(np.float64) for part in (images, depths, poses))
    vectors = poses[:, 1:].astype(np.float64)
    found = []
    for i, stamp_s in enumerate(rgb_s):
        j, k = np.argmin(np.abs(depth_s - stamp_s)), np.argmin(np.abs(pose_s - stamp_s))
        if abs(depth_s[j] - stamp_s) < max_dt_s and abs(pose_s[k] - stamp_s) < max_dt_s:
            found.append((i, j, k))
    kept = [found[0]]
    for item in found[1:]:
        if rgb_s[item[0]] - rgb_s[kept[-1][0]] > 1.0 / frame_rate:
            kept.append(item)
    return Loaded(
        [folder / images[i, 1] for i, _, _ in kept],
        [folder / depths[j, 1] for _, j, _ in kept],
        [float(rgb_s[i]) for i, _, _ in kept],
        np.array([pose_of(vectors[k]) for _, _, k in kept]),
    )


def tools_list(path):
    """The benchmark's tools: lines that begin with # are left out, commas and tabs are blanks."""
    lines = path.read_text().replace(",", " ").replace("\t", " ").split("\n")
    rows = [[word.strip() for word in line.split(" ") if word.strip()] for line in lines if line and line[0] != "#"]
    return {float(row[0]): row[1:] for row in rows if len(row) > 1}


def tools_associate(first, second, max_difference_s=0.02):
    """The benchmark's associate.py: the closest pairs first, each stamp once."""
    near = sorted((abs(a - b), a, b) for a in first for b in second if abs(a - b) < max_difference_s)
    pairs, left, right = [], set(first), set(second)
    for _, a, b in near:
        if a in left and b in right:
            left.remove(a)
            right.remove(b)
            pairs.append((a, b))
    return sorted(pairs)


def associate_py(folder):
    """associate.py of rgb.txt and depth.txt, and of rgb.txt and groundtruth.txt."""
    rgb, depth, poses = (tools_list(folder / name) for name in ("rgb.txt", "depth.txt", "groundtruth.txt"))
    pairs, truth = tools_associate(rgb, depth), dict(tools_associate(rgb, poses))
    return Loaded(
        [folder / rgb[a][0] for a, _ in pairs],
        [folder / depth[b][0] for _, b in pairs],
        [a for a, _ in pairs],
        np.array([pose_of([float(word) for word in poses[truth[a]]]) for a, _ in pairs]),
    )


def number_at_the_start(words):
    """What C++ reads into a double: 0 where there is no number."""
    found = re.match(r"[-+]?\d*\.?\d+(?:[eE][-+]?\d+)?", words)
    return float(found[0]) if found else 0.0


def orb_slam_rgbd_tum(folder):
    """ORB-SLAM2 and 3, rgbd_tum: every line of associations.txt that is not empty is a pair, comments too."""
    rows = [line.split() for line in (folder / "associations.txt").read_text().split("\n") if line]
    return Loaded(
        [folder / row[1] for row in rows],
        [folder / row[3] for row in rows],
        [number_at_the_start(row[0]) for row in rows],
    )


def orb_slam_mono_tum(folder):
    """ORB-SLAM2 and 3, mono_tum: three lines of rgb.txt are left out, whatever they hold."""
    rows = [line.split() for line in (folder / "rgb.txt").read_text().split("\n")[3:] if line]
    return Loaded([folder / row[1] for row in rows], None, [number_at_the_start(row[0]) for row in rows])


# --- Replica ---


def natural(name):
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def slam_replica(folder, key=None):
    """NICE-SLAM, Co-SLAM and GO-SLAM: sorted names, only jpg, and as many lines of traj.txt."""
    rgb = sorted(map(str, folder.glob("results/frame*.jpg")), key=key)
    depth = sorted(map(str, folder.glob("results/depth*.png")), key=key)
    lines = (folder / "traj.txt").read_text().splitlines()
    c2w = [np.array(list(map(float, lines[i].split()))).reshape(4, 4) for i in range(len(rgb))]
    return Loaded([Path(name) for name in rgb], [Path(name) for name in depth], None, np.array(c2w))


def splatam_replica(folder):
    """SplaTAM sorts names naturally, by their numbers."""
    return slam_replica(folder, key=natural)


# --- EuRoC ---


def orb_slam3_mono_euroc(folder):
    """ORB-SLAM3, mono_euroc: each line of the file of times, with .png, is an image; its number is nanoseconds."""
    lines = [line for line in (folder / "mav0/cam0/timestamps.txt").read_text().split("\n") if line]
    rgb = [folder / "mav0/cam0/data" / f"{line}.png" for line in lines]
    return Loaded(rgb, None, [number_at_the_start(line) / 1e9 for line in lines])


def evo_euroc(folder):
    """evo, and others that read data.csv by rows of commas: comments left out; t [ns], p, q with w first."""
    rows = [
        line.split(",")
        for line in (folder / "mav0/state_groundtruth_estimate0/data.csv").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    images = [
        line.split(",")[1]
        for line in (folder / "mav0/cam0/data.csv").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    poses = [pose_of([*map(float, row[1:4]), *map(float, row[5:8]), float(row[4])]) for row in rows]
    return Loaded(
        [folder / "mav0/cam0/data" / name for name in images],
        None,
        [float(row[0]) / 1e9 for row in rows],
        np.array(poses),
    )


# --- TUM-VI ---


def orb_slam3_mono_tum_vi(folder):
    """ORB-SLAM3's loaders for TUM-VI: as for EuRoC, each line of the file of times, with .png, is an image."""
    return orb_slam3_mono_euroc(folder)


def dm_vio(folder):
    """DM-VIO: the images sorted, as many lines of times, which are a number, seconds and an exposure; # skipped."""
    rgb = sorted((folder / "mav0/cam0/data").iterdir())
    rows = [line.split() for line in (folder / "dso/cam0/times.txt").read_text().splitlines() if line[0] != "#"]
    assert {len(row) for row in rows} == {3}
    assert len(rows) == len(rgb)
    assert [int(row[0]) for row in rows] == [int(path.stem) for path in rgb]
    truth = [line.split(",") for line in (folder / "dso/gt_imu.csv").read_text().splitlines() if line[0] != "#"]
    poses = [pose_of([*map(float, row[1:4]), *map(float, row[5:8]), float(row[4])]) for row in truth]
    return Loaded(rgb, None, [float(row[1]) for row in rows], np.array(poses))


def pandas_tum_vi(folder):
    """Readers by the names of mocap0's columns, and rerun's example: a header, then rows."""
    with (folder / "mav0/mocap0/data.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    columns = [*(f" p_RS_R_{axis} [m]" for axis in "xyz"), *(f" q_RS_{axis} []" for axis in "xyzw")]
    with (folder / "dso/cam0/times.txt").open() as table:
        names = [line.split(" ")[0] for line in list(table)[1:]]
    return Loaded(
        [folder / "mav0/cam0/data" / f"{name}.png" for name in names],
        None,
        [int(row["#timestamp [ns]"]) / 1e9 for row in rows],
        np.array([pose_of([float(row[name]) for name in columns]) for row in rows]),
    )


# --- VSLAM-LAB ---


def vslamlab(folder):
    """VSLAM-LAB's systems: rgb.csv by the names of its columns; groundtruth.csv sorted by time."""
    with (folder / "rgb.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    with (folder / "groundtruth.csv").open(newline="") as table:
        poses = [list(map(float, row.values())) for row in csv.DictReader(table)]
    return Loaded(
        [folder / row["path_rgb_0"] for row in rows],
        [folder / row["path_depth_0"] for row in rows],
        [int(row["ts_rgb_0 (ns)"]) / 1e9 for row in rows],
        np.array([pose_of(row[1:8]) for row in sorted(poses)]),
    )


# --- KITTI, ScanNet, nerfstudio, COLMAP ---


def matrix_camera(matrix):
    """fx, fy, cx, cy of a matrix whose pixels' centres are at whole coordinates."""
    return matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]


def pykitti_odometry(folder):
    """pykitti's odometry and evo's kitti: sorted images, and as many lines of times and poses; P2 is the camera's."""
    rgb = sorted((folder / "image_2").glob("*.png"))
    rows = {line.split(":")[0]: line.split(":")[1] for line in (folder / "calib.txt").read_text().splitlines()}
    cameras = {name: np.array(text.split(), float).reshape(3, 4) for name, text in rows.items()}
    assert sorted(cameras) == ["P0", "P1", "P2", "P3"]
    poses = np.array([line.split() for line in (folder / "poses.txt").read_text().splitlines()], float)
    c2w = np.tile(np.eye(4), (len(poses), 1, 1))
    c2w[:, :3] = poses.reshape(-1, 3, 4)
    beside = np.eye(4)  # P2 = K [1 | t]: where camera 0 is in the axes of camera 2
    beside[:3, 3] = np.linalg.solve(cameras["P2"][:, :3], cameras["P2"][:, 3])
    stamps_s = [float(line) for line in (folder / "times.txt").read_text().splitlines()]
    assert len(rgb) == len(stamps_s) == len(c2w)
    depth = sorted((folder / "depth_2").glob("*.png"))
    return Loaded(rgb, depth, stamps_s, c2w @ np.linalg.inv(beside), matrix_camera(cameras["P2"]))


def slam_scannet(folder):
    """NICE-SLAM, Co-SLAM and SplaTAM: names sorted by their whole numbers; a pose of four lines in each file."""

    def sorted_files(name, suffix):
        return sorted((folder / name).glob(f"*.{suffix}"), key=lambda path: int(path.stem))

    c2w = [
        np.array([line.split() for line in path.read_text().splitlines()], float)
        for path in sorted_files("pose", "txt")
    ]
    color, depth = (np.loadtxt(folder / f"intrinsic/intrinsic_{kind}.txt") for kind in ("color", "depth"))
    assert color.shape == (4, 4)
    assert np.array_equal(color, depth)
    for kind in ("color", "depth"):
        assert np.array_equal(np.loadtxt(folder / f"intrinsic/extrinsic_{kind}.txt"), np.eye(4))
    return Loaded(sorted_files("color", "jpg"), sorted_files("depth", "png"), None, np.array(c2w), matrix_camera(color))


def nerfstudio_parser(folder):
    """nerfstudio's parser: frames sorted by their files' names, OpenGL's axes, pixels' corners at whole coordinates."""
    meta = json.loads((folder / "transforms.json").read_text())
    frames = sorted(meta["frames"], key=lambda frame: frame["file_path"])
    opengl = np.array([frame["transform_matrix"] for frame in frames])
    assert meta["camera_model"] == "OPENCV"
    assert [meta[key] for key in ("k1", "k2", "p1", "p2")] == [0, 0, 0, 0]
    assert all(frame["depth_path"] == frame["depth_file_path"] for frame in frames)  # Instant NGP's and SplaTAM's name
    return Loaded(
        [folder / frame["file_path"] for frame in frames],
        [folder / frame["depth_file_path"] for frame in frames],
        [frame["timestamp"] for frame in frames],
        opengl @ np.diag([1.0, -1.0, -1.0, 1.0]),
        (meta["fl_x"], meta["fl_y"], meta["cx"] - 0.5, meta["cy"] - 0.5),
    )


def colmap_text(folder):
    """COLMAP's own reader of text models: each image's line, then that of its points whatever it holds."""
    (camera,) = [line.split() for line in (folder / "sparse/0/cameras.txt").read_text().splitlines() if line[0] != "#"]
    assert (camera[0], camera[1]) == ("1", "PINHOLE")
    fx, fy, cx, cy = map(float, camera[4:])
    found = {}
    lines = iter((folder / "sparse/0/images.txt").read_text().split("\n"))
    for line in lines:
        if not line or line[0] == "#":
            continue
        words = line.split(" ")
        assert len(words) == 10
        assert words[8] == "1"
        w, x, y, z, *shift = map(float, words[1:8])
        w2c = pose_of([*shift, x, y, z, w])
        found[words[9]] = int(words[0]), np.linalg.inv(w2c)
        assert next(lines) == ""
    assert len({number for number, _ in found.values()}) == len(found)
    assert all(line[0] == "#" for line in (folder / "sparse/0/points3D.txt").read_text().splitlines())
    names = sorted(found)
    return Loaded(
        [folder / "images" / name for name in names],
        [folder / "depth" / name for name in names],
        None,
        np.array([found[name][1] for name in names]),
        (fx, fy, cx - 0.5, cy - 0.5),
    )
