# SPDX-License-Identifier: GPL-3.0-or-later
"""Estimates that systems wrote, read: files written by hand, and what is wrong with others."""

import warnings
import zipfile

import numpy as np
import pytest
from refusals import refused

from noisy_world.core.errors import InputError, NotFiniteError
from noisy_world.evaluate.estimates import read_estimate, read_poses
from noisy_world.trajectories.pose_files import PER_SECOND
from noisy_world.trajectories.formats import TRAJECTORY_FORMATS as FORMATS

STEP_S = 0.05


def index_of(count, first_s=0.0):
    frames = [
        {"index": k, "stamp_s": first_s + k * STEP_S, "colour": f"/data/rgb/{k:06d}.png", "depth": None}
        for k in range(count)
    ]
    return {"frames": frames}


INDEX = index_of(6)
# Turned by 90 degrees about z, at (k, 2, 3): quaternion x y z w, and the matrix row by row.
QUAT_XYZW = "0 0 0.70710678118654757 0.70710678118654757"


def turned(k):
    return np.array([[0.0, -1, 0, k], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


def is_turned(estimate, numbers, first_s=0.0):
    stamps_s = first_s + STEP_S * np.array(numbers, dtype=float)
    return np.allclose(estimate.stamps_s, stamps_s, rtol=0, atol=1e-6) and np.allclose(
        estimate.c2w, np.array([turned(k) for k in numbers]).reshape(-1, 4, 4), atol=1e-12
    )


def row(matrix, rows=4):
    return " ".join(map(repr, matrix[:rows].ravel().tolist())) + "\n"


# --- text ---


@pytest.mark.parametrize("unit", PER_SECOND)
@pytest.mark.parametrize("first_s", [0.0, 1305031102.25])
def test_tum_in_the_unit_of_the_frames(tmp_path, unit, first_s):
    numbers = [1, 2, 4]
    stamps = [first_s + k * STEP_S for k in numbers]
    texts = [f"{t * PER_SECOND[unit]:.6f}" for t in stamps]
    path = tmp_path / "estimate.txt"
    path.write_text("".join(f"{t} {k} 2 3 {QUAT_XYZW}\n" for t, k in zip(texts, numbers, strict=True)))
    found = read_estimate("tum", path, index_of(6, first_s))
    assert np.allclose(found.stamps_s, stamps, rtol=0, atol=1e-6)
    assert np.allclose(found.c2w, [turned(k) for k in numbers])


def test_one_pose_that_meets_a_frame_says_no_unit(tmp_path):
    path = tmp_path / "estimate.txt"
    path.write_text("".join(f"{t} {t} 2 3 {QUAT_XYZW}\n" for t in (5000, 6000, 7000)))  # as us all are near frame 0
    found = read_poses(path, "tum", frames_s=np.arange(6) * STEP_S)
    assert found.stamps_s.tolist() == [5000, 6000, 7000]


def test_conventions_of_a_system(tmp_path):
    path = tmp_path / "estimate.txt"
    path.write_text(f"0.05 1 2 3 {QUAT_XYZW}\n")
    w2c = read_estimate("tum", path, INDEX, direction="w2c")
    assert np.allclose(w2c.c2w[0] @ turned(1), np.eye(4))
    gl = read_estimate("tum", path, INDEX, axes="opengl")
    assert np.allclose(gl.c2w[0], turned(1) @ np.diag([1, -1, -1, 1]))
    refused(read_estimate, "splatam", path, INDEX, axes="opengl", names=["splatam", "leave axes out"])
    refused(read_estimate, "tumm", path, INDEX, names="tumm", error=ValueError)


@pytest.mark.parametrize(("name", "rows"), [("kitti", 3), ("replica", 4)])
def test_lines_without_stamps_are_those_of_all_frames(tmp_path, name, rows):
    path = tmp_path / "estimate.txt"
    path.write_text("".join(row(turned(k), rows) for k in range(6)))
    assert is_turned(read_estimate(name, path, INDEX), range(6))
    path.write_text("".join(row(turned(k), rows) for k in range(5)))
    refused(read_estimate, name, path, INDEX, names=[str(path), "5 poses for 6 frames"])


def test_matrices_by_number(tmp_path):
    (tmp_path / "poses").mkdir()
    for k in (0, 3, 5):
        (tmp_path / f"poses/frame-{k:06d}.pose.txt").write_text("\n".join(row(line) for line in turned(k)))
    assert is_turned(read_estimate("matrices", tmp_path / "poses", INDEX), [0, 3, 5])
    refused(read_estimate, "matrices", tmp_path / "poses", index_of(4), names="frame 5")
    (tmp_path / "poses.txt").write_text("".join(f"{k} {row(turned(k), 3)}" for k in (0, 3, 5)))  # as KITTI-360's
    assert is_turned(read_estimate("auto", tmp_path / "poses.txt", INDEX), [0, 3, 5])
    log = tmp_path / "path.log"
    log.write_text("".join(f"{k} {k} {k + 1}\n" + "".join(row(line) for line in turned(k)) for k in (0, 2)))
    assert is_turned(read_estimate("log", log, INDEX), [0, 2])


def test_colmap(tmp_path):
    lines = [
        "# Image list with two lines of data per image:",
        "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
    ]
    for number, k in enumerate((4, 1), 1):
        w2c = np.linalg.inv(turned(k))
        lines += [
            f"{number} 0.7071067811865476 0 0 -0.7071067811865476 {' '.join(map(str, w2c[:3, 3]))} 1 rgb/{k:06d}.png",
            "" if k == 1 else "2362.39 248.498 58396 1784.7 268.254 59027",
        ]
    path = tmp_path / "images.txt"
    for end in ("\n", ""):
        path.write_text("\n".join(lines) + end)
        assert is_turned(read_estimate("colmap", path, INDEX), [1, 4])
        assert is_turned(read_estimate("colmap", tmp_path, INDEX), [1, 4])
    path.write_text("\r\n".join(lines).replace("rgb/", "C:\\data\\rgb\\"))
    assert is_turned(read_estimate("colmap", path, INDEX), [1, 4])
    path.write_text("\n".join(lines).replace("000004.png", "left.png"))
    refused(read_estimate, "colmap", path, INDEX, names=[str(path), "line 3: 'rgb/left.png'"])
    path.write_text("\n".join(lines[:2]))
    assert len(read_estimate("colmap", path, INDEX)) == 0
    path.write_text("\n".join([*lines[:4], "1 2 3"]))
    refused(read_estimate, "colmap", path, INDEX, names=[str(path), "line 5: ", "IMAGE_ID QW"])


# --- VSLAM-LAB ---

HEAD = "ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw\n"


@pytest.mark.parametrize(
    ("head", "texts", "separator"),
    [
        (HEAD, ["150000000", "50000000", "150000000"], ","),
        ("timestamp,tx,ty,tz,qx,qy,qz,qw\n", ["0.15", "0.05"], ","),
        ("", ["0.15", "0.05"], " "),
        (HEAD, ["150000000.0", "50000000.0"], ","),
        ("", ["150000000", "50000000"], " "),
        ("timestamp,tx,ty,tz,qx,qy,qz,qw\n", ["150000000.5", "50000000.25"], ","),
    ],
)
def test_vslamlab_in_any_order_and_unit(tmp_path, head, texts, separator):
    path = tmp_path / "00000_KeyFrameTrajectory.csv"
    numbers = [3, 1, 3]
    rows = [" ".join([text, str(k), "2 3", QUAT_XYZW]) for text, k in zip(texts, numbers, strict=False)]
    path.write_text(head + "".join(line.replace(" ", separator) + "\n" for line in rows))
    assert is_turned(read_estimate("vslamlab", path, INDEX), [1, 3])


def test_vslamlab_on_a_real_clock_is_exact(tmp_path):
    stamps_ns = [1403636579763555584 + k * 50_000_000 for k in range(6)]
    index = {"frames": [{"stamp_s": ns / 10**9, "colour": ""} for ns in stamps_ns]}
    path = tmp_path / "00000_KeyFrameTrajectory.csv"
    path.write_text(HEAD + "".join(f"{ns},1,2,3,0,0,0,1\n" for ns in stamps_ns[::2]))
    assert read_estimate("vslamlab", path, index).stamps_s.tolist() == [ns / 10**9 for ns in stamps_ns[::2]]


def test_vslamlab_results_that_are_none(tmp_path):
    path = tmp_path / "00000_KeyFrameTrajectory.csv"
    path.write_text(HEAD)
    assert len(read_estimate("vslamlab", path, INDEX)) == 0
    path.write_text(HEAD + "50000000,1,2,3,0,0,0,1\n50000000,1,2,4,0,0,0,1\n")
    kept = read_estimate("vslamlab", path, INDEX)
    assert kept.c2w[:, :3, 3].tolist() == [[1, 2, 3]]  # of two poses of one stamp, the first
    path.write_text(HEAD + "50000000,1,2,3,0,0,0,1.5\n")
    refused(read_estimate, "vslamlab", path, INDEX, names=[str(path), "line 2: ", "1.5"])


# --- arrays ---


def test_arrays(tmp_path):
    poses = np.array([turned(k) for k in range(6)])
    np.save(tmp_path / "all.npy", poses.astype(np.float32))
    assert is_turned(read_estimate("array", tmp_path / "all.npy", INDEX), range(6))
    np.save(tmp_path / "rows.npy", poses[:, :3])
    assert is_turned(read_estimate("array", tmp_path / "rows.npy", INDEX), range(6))
    np.savez(tmp_path / "stamped.npz", anything=poses[[3, 1]], timestamps=[0.15, 0.05])
    assert is_turned(read_estimate("array", tmp_path / "stamped.npz", INDEX), [1, 3])
    stamps_ns = [1403636579763555584 + k * 50_000_000 for k in range(6)]
    np.savez(tmp_path / "ns.npz", c2w=poses[[3, 1]], timestamps=np.array(stamps_ns)[[3, 1]])
    of_clock = {"frames": [{"stamp_s": ns / 1e9, "colour": ""} for ns in stamps_ns]}
    assert is_turned(read_estimate("array", tmp_path / "ns.npz", of_clock), [1, 3], stamps_ns[0] / 1e9)
    np.savez(tmp_path / "numbered.npz", c2w=poses[[5, 2]], frames=[5, 2], other=poses)
    assert is_turned(read_estimate("array", tmp_path / "numbered.npz", INDEX), [2, 5])
    np.savez(tmp_path / "w2c.npz", w2c=np.linalg.inv(poses))
    for how in ({}, {"direction": "w2c"}):
        assert is_turned(read_estimate("array", tmp_path / "w2c.npz", INDEX, **how), range(6))
    lost = poses.copy()
    lost[4:] = 0
    np.save(tmp_path / "lost.npy", lost)
    assert is_turned(read_estimate("array", tmp_path / "lost.npy", INDEX), range(4))


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"a": np.zeros((5, 4, 4)), "b": np.zeros((5, 4, 4))}, "holds 2 arrays of N x 4 x 4; name the poses"),
        ({"poses": np.zeros(6)}, "its poses are an array of 6, but have to be N x 4 x 4"),
        ({"poses": np.zeros((5, 4, 4))}, "has 5 poses for 6 frames"),
        ({"poses": np.eye(4), "frames": 3.0}, "its poses are an array of 4 x 4, but have to be N x 4 x 4"),
        ({"poses": np.zeros((1, 4, 4)), "frames": 3.0}, "frames: is one number, but has to have one entry for each"),
        ({"poses": np.float64(1.0), "frames": [3]}, "poses: is one number, but has to have one entry for each pose"),
        ({"poses": np.array([["a"]])}, "poses: holds <U1, but has to be numbers"),
        ({"poses": np.array([None])}, "is no array of numbers as numpy writes it"),
        ({"poses": np.stack([2 * np.eye(4)] * 6)}, "frame 0: the last row of the pose is 0 0 0 2, not 0 0 0 1"),
        ({"poses": np.stack([np.diag([2.0, 2, 2, 1])] * 6)}, "frame 0: the left 3 x 3 numbers are no rotation: R^T R"),
        ({"poses": np.stack([np.diag([1.0, 1, -1, 1])] * 6)}, "frame 0: the pose mirrors (determinant -1)"),
        ({"poses": np.stack([np.eye(4)] * 2), "frames": [1, 1]}, "frame 1: has two poses"),
        ({"poses": np.stack([np.eye(4)] * 2), "frames": [0, 6]}, "has a pose for frame 6, but there are 6, from 0"),
        ({"poses": np.stack([np.eye(4)] * 2), "frames": [0, 0.5]}, "frames: are no whole numbers"),
        ({"poses": np.stack([np.eye(4)] * 2), "stamps_s": [0.0]}, "stamps_s: has to be 2 finite numbers, one for each"),
    ],
)  # fmt: skip
def test_arrays_that_are_no_estimate(tmp_path, arrays, words):
    np.savez(tmp_path / "a.npz", **arrays)
    refused(read_estimate, "array", tmp_path / "a.npz", INDEX, names=["a.npz: ", words])


def test_splatam(tmp_path):
    w2c = np.array([np.linalg.inv(turned(k)) for k in range(6)])
    half = np.full(6, np.pi / 4)
    quats = 7.0 * np.array([np.cos(half), 0 * half, 0 * half, -np.sin(half)])  # of w2c, any length
    path = tmp_path / "params.npz"
    np.savez(path, cam_unnorm_rots=quats[None], cam_trans=w2c[:, :3, 3].T[None], means3D=np.zeros((9, 3)))
    found = read_estimate("splatam", path, INDEX)
    assert is_turned(found, range(6))
    np.savez(path, cam_unnorm_rots=0 * quats[None], cam_trans=w2c[:, :3, 3].T[None])
    refused(read_estimate, "splatam", path, INDEX, names=[str(path), "frame 0: "])
    np.savez(path, cam_unnorm_rots=quats, cam_trans=w2c[:, :3, 3].T[None])
    refused(read_estimate, "splatam", path, INDEX, names=[str(path), "cam_unnorm_rots", "(4, 6)", "(1, 3, 6)"])
    np.savez(path, cam_trans=w2c)
    refused(read_estimate, "splatam", path, INDEX, names=[str(path), "cam_unnorm_rots"])


def test_quaternions_of_numbers_that_cannot_be_squared_are_refused(tmp_path):
    vslamlab = "ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw\n50000000,1,2,3,0,1e300,0,1\n"
    colmap = "1 1e300 0 0 0 1 2 3 1 000000.png\n\n"
    quats, trans = np.full((1, 4, 6), 1e300), np.zeros((1, 3, 6))
    np.savez(tmp_path / "params.npz", cam_unnorm_rots=quats, cam_trans=trans)
    (tmp_path / "v.csv").write_text(vslamlab)
    (tmp_path / "images.txt").write_text(colmap)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refused(read_estimate, "vslamlab", tmp_path / "v.csv", INDEX, names=["v.csv", "1e+300"])
        for reader, name in (("colmap", "images.txt"), ("splatam", "params.npz")):
            refused(read_estimate, reader, tmp_path / name, INDEX, names=[name, "1e154"])


def test_an_archive_of_what_is_no_array_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "params.npz", "w") as archive:
        for name in ("poses", "cam_unnorm_rots", "cam_trans"):
            archive.writestr(f"{name}.npy", b"[1.0, 2.0]")
    for reader in ("array", "splatam"):
        refused(read_estimate, reader, tmp_path / "params.npz", INDEX, names="params.npz: ")


# --- nothing, and no numbers ---

TEXTS = {"tum": 8, "euroc": 8, "vslamlab": 8}
HEADERS = ["timestamp tx ty tz qx qy qz qw\n", "ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw\n"]


@pytest.mark.parametrize("name", [*TEXTS, "kitti", "replica", "colmap", "matrices", "log", "auto"])
@pytest.mark.parametrize("text", ["", "\n\n", "# comment\n", *HEADERS])
def test_a_file_of_no_pose_is_an_estimate_of_none(tmp_path, name, text):
    if name == "colmap" and text in HEADERS:
        pytest.skip("a line of COLMAP's is an image")
    path = tmp_path / "estimate.txt"
    path.write_text(text)
    assert len(read_estimate(name, path, INDEX)) == 0


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("kept", [[0, 1, 3, 5], []])
def test_rows_of_nan_are_lost_frames(tmp_path, name, kept):
    separator = "," if name in ("euroc", "vslamlab") else " "
    stamp = (lambda k: k * 50_000_000) if name == "euroc" else (lambda k: k * STEP_S)
    quat = QUAT_XYZW.split()
    quat = [quat[3], *quat[:3]] if name == "euroc" else quat
    path = tmp_path / "estimate.txt"
    poses = [[str(k), "2", "3", *quat] if k in kept else ["nan"] * 7 for k in range(6)]
    path.write_text("".join(separator.join([str(stamp(k)), *pose]) + "\n" for k, pose in enumerate(poses)))
    assert is_turned(read_estimate(name, path, INDEX), kept)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("name", TEXTS)
def test_not_finite_is_told_apart_from_unreadable(tmp_path, name, value):
    separator = "," if name in ("euroc", "vslamlab") else " "
    path = tmp_path / "estimate.txt"
    path.write_text("\n".join(separator.join(["0", "0", *[value] * (width - 2)]) for width in [TEXTS[name]] * 6))
    refused(read_estimate, name, path, INDEX, names="line 1", error=NotFiniteError)


def test_arrays_that_are_not_finite(tmp_path):
    poses = np.stack([np.eye(4)] * 6)
    poses[2, 0, 3] = np.nan
    np.save(tmp_path / "poses.npy", poses)
    refused(read_estimate, "array", tmp_path / "poses.npy", INDEX, names="poses.npy: frame 2: ", error=NotFiniteError)
    quats, trans = np.tile([[[1.0], [0], [0], [0]]], (1, 1, 6)), np.zeros((1, 3, 6))
    trans[0, 1, 5] = np.inf
    path = tmp_path / "params.npz"
    np.savez(path, cam_unnorm_rots=quats, cam_trans=trans)
    refused(read_estimate, "splatam", path, INDEX, names=f"{path}: frame 5: ", error=NotFiniteError)
    (tmp_path / "images.txt").write_text("1 1 0 0 0 nan 0 0 1 000003.png\n\n")
    refused(read_estimate, "colmap", tmp_path, INDEX, names=["images.txt", "line 1: "], error=NotFiniteError)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("data", [None, b"\x00\x01\x02", b"PK\x03\x04", b"hello world\n", b"\x80\x02."])
def test_what_is_no_estimate_is_one_line(tmp_path, name, data):
    path = tmp_path / "estimate"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(InputError) as error:
        read_estimate(name, path, INDEX)
    assert not isinstance(error.value, NotFiniteError)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize("name", ["tum", "vslamlab"])
def test_stamps_of_another_sequence_stay_as_they_are(tmp_path, name):
    path = tmp_path / "estimate.txt"
    path.write_text(f"1305031102.0 1 2 3 {QUAT_XYZW}\n1305031103.0 1 2 3 {QUAT_XYZW}\n")
    assert read_estimate(name, path, INDEX).stamps_s.tolist() == [1305031102.0, 1305031103.0]


@pytest.mark.parametrize("lost", [[2], range(6)])
def test_lost_frames_in_a_folder_of_matrices(tmp_path, lost):
    kept = [k for k in range(6) if k not in lost]
    for k in range(6):
        pose = np.full((4, 4), np.nan) if k in lost else turned(k)
        (tmp_path / f"{k}.txt").write_text("".join(map(row, pose)))
    assert is_turned(read_estimate("matrices", tmp_path, INDEX), kept)
    assert is_turned(read_estimate("auto", tmp_path, INDEX), kept)


def test_coordinates_far_out_and_half_turns(tmp_path):
    poses = np.stack([np.eye(4)] * 6)
    poses[:, :3, :3] = np.diag([-1.0, -1, 1])
    poses[:, :3, 3] = 1e5 + np.arange(6)[:, None] * [0.25, 0.5, 0.125]
    np.save(tmp_path / "far.npy", poses.astype(np.float32))
    assert np.array_equal(read_estimate("array", tmp_path / "far.npy", INDEX).c2w, poses)


def test_lists_of_images_that_never_end(tmp_path):
    (tmp_path / "images.txt").write_bytes(b"\n" * 2_000_001 + b"1 1 0 0 0 0 0 0 1 a.png\n")
    refused(read_estimate, "colmap", tmp_path / "images.txt", {"frames": []}, names=["images.txt", "2000000"])
