# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings of others, read at their own conventions; what writes them is in tests/support/recorded_layouts.py."""

import itertools
import json
import re

import numpy as np
import pytest
from refusals import refused
from recorded_layouts import FRAMES, HALF_M, WRITERS, WRITTEN, image, kitti, poses, scannet, text_of

from noisy_world.layouts import LAYOUTS, RECORDED, find_sequence
from noisy_world.core.schema import ConfigPath
from noisy_world.sources.recording import read_recording
from noisy_world.core.lens import Distortion


def seen_twice(stored, frames, scale_per_m):
    """Pairs of the same place of a wall, in the world (N, 3), as two frames of a recording tell it.

    A pixel of the first frame is carried into the world, and from there into the second frame, where the depth of the
    four pixels around it is interpolated: the inverse of depth is linear on a plane.
    """
    camera = stored.optics.depth.intrinsics if stored.optics.depth else stored.known_camera
    k = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    first, second = (stored.frame(row).depth_m.astype(float) for row in frames)
    one, other = (stored.trajectory.c2w[row] for row in frames)
    every = max(1, first.shape[1] // 64)
    v, u = np.mgrid[2 : first.shape[0] : every, 0 : first.shape[1] : every].reshape(2, -1)
    there = first[v, u] > 0
    pixels = np.stack([u, v, np.ones_like(u)])[:, there].astype(float)
    world = one[:3, :3] @ (np.linalg.inv(k) @ pixels * first[v, u][there]) + one[:3, 3:]
    local = other[:3, :3].T @ (world - other[:3, 3:])
    world, local = (part[:, local[2] > 0.1] for part in (world, local))
    x, y = (k @ local / local[2])[:2]
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    inside = (left >= 0) & (top >= 2) & (left < second.shape[1] - 1) & (top < second.shape[0] - 1)
    x, y, left, top, world = x[inside], y[inside], left[inside], top[inside], world[:, inside]
    around = np.array([second[top + dy, left + dx] for dy in (0, 1) for dx in (0, 1)])
    with np.errstate(divide="ignore"):
        a, b, c, d = 1 / around
    flat = np.isfinite(a + b + c + d) & (np.abs(a + d - b - c) * around.max(axis=0) ** 2 < 2.5 / scale_per_m)
    across, down = x - left, y - top
    depth = 1 / ((a * (1 - across) + b * across) * (1 - down) + (c * (1 - across) + d * across) * down)
    rays = np.linalg.inv(k) @ np.stack([x, y, np.ones_like(x)])
    again = other[:3, :3] @ (rays * depth) + other[:3, 3:]
    return world[:, flat].T, again[:, flat].T


@pytest.mark.one_python
@pytest.mark.parametrize("name", ["icl_nuim", *sorted(WRITTEN)])  # of others each pixel is held to the box below
def test_a_point_seen_in_two_frames_is_one_place_of_the_world(name, tmp_path):
    folder = tmp_path / "recording"
    folder.mkdir()
    written = {**WRITERS, **WRITTEN}[name](folder)
    stored = find_sequence(folder)
    if name in WRITTEN:  # those of others are held to that below
        assert np.abs(stored.trajectory.c2w - written.c2w).max() < 1e-9
        assert intrinsics(stored.known_camera) == written.colour_k
        assert stored.depth_scale_per_m == written.scale_per_m
    pairs = itertools.combinations(range(len(stored.trajectory)), 2)
    one, other = (
        np.concatenate(places)
        for places in zip(*(seen_twice(stored, frames, written.scale_per_m) for frames in pairs), strict=True)
    )
    # Both depths are rounded to half a step, along rays that are longer than the depth. Within 5 cm of an edge of the
    # box, where the second nearest wall is, the four pixels around a place may be of two walls.
    off_m = np.abs(one - other).max(axis=1)
    on_one_wall = np.sort(np.abs(HALF_M - np.abs(one)), axis=1)[:, 1] > 0.05
    assert np.count_nonzero(on_one_wall) > 100
    assert off_m[on_one_wall].max() < 1.5 / written.scale_per_m
    assert np.median(off_m) < 1.0 / written.scale_per_m


def intrinsics(camera):
    return camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px


@pytest.mark.one_python
@pytest.mark.parametrize("name", sorted(WRITERS))
def test_each_layout_comes_back_as_it_was_written(name, tmp_path):
    folder = tmp_path / "recording"
    folder.mkdir()
    written = WRITERS[name](folder)
    assert [item for item, layout in {**LAYOUTS, **RECORDED}.items() if layout.recognises(folder)] == [name]
    stored = find_sequence(folder, poses="keep")
    known = [row for row in range(FRAMES) if row not in written.lost]
    assert np.flatnonzero(stored.trajectory.known).tolist() == known
    assert np.abs(stored.trajectory.c2w[known] - written.c2w[known]).max() < 1e-9
    assert np.allclose(stored.stamps.rgb.seconds, np.array(written.numbers) / written.hz, rtol=0, atol=1e-12)
    assert np.allclose(intrinsics(stored.known_camera)[2:], np.abs(written.colour_k)[2:], rtol=0, atol=1e-9)
    depth_camera = stored.optics.depth.intrinsics if stored.optics.depth else stored.known_camera
    assert np.allclose(intrinsics(depth_camera), written.depth_k, rtol=0, atol=1e-9)
    rays = depth_camera.ray_directions()
    for row in range(FRAMES):
        frame = stored.frame(row)
        assert abs(int(frame.rgb[5, 5, 2]) - 10 * row) <= 2
        steps = np.where(written.steps[row] == 65535, 0, written.steps[row])
        assert np.array_equal(np.rint(frame.depth_m.astype(float) * written.scale_per_m), steps)
        assert not frame.depth_m[:2, :3].any()
        if row not in written.lost:
            # What a pixel shows lies on the box, seen from every frame: so do two frames that see one place.
            c2w = stored.trajectory.c2w[row]
            world = (rays * frame.depth_m.astype(float)[..., None])[2:] @ c2w[:3, :3].T + c2w[:3, 3]
            off_m = np.abs((np.abs(world) - HALF_M).max(axis=-1))
            assert off_m.max() < 1.5 / written.scale_per_m
    dropped = find_sequence(folder)
    assert len(dropped.trajectory) == len(known)
    assert dropped.trajectory.posed is None
    assert any("no valid pose" in note for note in dropped.notes) == bool(written.lost)
    hashed = read_recording(folder, ConfigPath("preset")).hashes()
    assert len(hashed["trajectory_sha256"]) == len(hashed["sequence_sha256"]) == 64
    bare = find_sequence(folder, poses="none")
    assert (len(bare.trajectory), bare.trajectory.known.any()) == (FRAMES, False)
    if written.lost:
        refused(
            find_sequence,
            folder,
            poses="require",
            names=("1 of 4 frames", f"frame {written.lost[0]}"),
        )


def without_depth(folder):
    """Take away the depth of a recording, and what says that there is any."""
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        inside = path.relative_to(folder).as_posix()
        if re.search(r"(^|[/.])depth(0|_0)?(/|\.png|\.txt)", inside):
            path.unlink()
        elif path.name == "transforms.json":
            document = json.loads(path.read_text())
            for frame in document["frames"]:
                del frame["depth_file_path"]
            path.write_text(json.dumps(document))
        elif path.name == "rgb.csv":
            rows = [line.split(",")[:2] for line in path.read_text().splitlines()]
            path.write_text("".join(",".join(row) + "\n" for row in rows))
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir() and not any(path.iterdir()):
            path.rmdir()


@pytest.mark.parametrize(
    "name", ["bundlefusion", "colmap", "euroc", "nerfstudio", "open3d", "scannet", "seven_scenes", "tum", "vslamlab"]
)
def test_a_recording_may_lack_depth(name, tmp_path):
    {**WRITERS, **WRITTEN}[name](tmp_path)
    whole = find_sequence(tmp_path)
    without_depth(tmp_path)
    found = find_sequence(tmp_path)
    assert (found.rgb_files, found.depth_files) == (whole.rgb_files, ())
    assert found.frame(1).rgb.any()
    assert np.array_equal(found.trajectory.c2w, whole.trajectory.c2w)
    assert np.array_equal(found.stamps.rgb.seconds, whole.stamps.rgb.seconds)
    assert (found.camera, found.optics.distortion) == (whole.camera, whole.optics.distortion)


def test_kitti_has_its_poses_beside_the_sequences(tmp_path):
    # As the benchmark's archives unpack: dataset/sequences/07/image_2 and dataset/poses/07.txt.
    folder, truth = tmp_path / "dataset/sequences/07", tmp_path / "dataset/poses/07.txt"
    for path in (folder, truth.parent):
        path.mkdir(parents=True)
    truth.touch()
    assert LAYOUTS["kitti"].reader.poses_path(folder, "drop").samefile(truth)


def test_kitti_has_the_poses_of_the_camera_that_is_read(tmp_path):
    written = kitti(tmp_path)
    found = find_sequence(tmp_path)
    np.testing.assert_allclose(found.trajectory.c2w, written.c2w, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.stamps.rgb.seconds, 0.1036 * np.arange(FRAMES), rtol=0, atol=1e-9)
    assert intrinsics(found.known_camera) == written.colour_k
    assert found.depth_files == ()
    (tmp_path / "image_2/000001.png").unlink()
    np.testing.assert_allclose(find_sequence(tmp_path).stamps.rgb.seconds, 0.1036 * np.array([0, 2, 3]), atol=1e-9)
    for name, text, said in (
        ("calib.txt", "P2: 1 2 3\n", ("calib.txt", "P2", "3 x 4")),
        ("times.txt", "0\n1\n", ("times.txt", "numbered to 3")),
        ("times.txt", "0\n2\n1\n3\n", ("times.txt", "later")),
    ):
        (tmp_path / name).write_text(text)
        refused(find_sequence, tmp_path, names=said)
        kitti(tmp_path)
    (tmp_path / "poses.txt").unlink()
    refused(find_sequence, tmp_path, names=("has no file of poses", "poses: none"))
    assert not find_sequence(tmp_path, poses="keep").trajectory.known.any()


def test_a_list_of_pairs_is_a_recording(tmp_path):
    WRITTEN["tum"](tmp_path)
    whole = find_sequence(tmp_path)
    rows = [
        [f"{depth.stem} depth/{depth.name}", f"{rgb.stem} rgb/{rgb.name}"]  # which are named by their stamps
        for rgb, depth in zip(whole.rgb_files, whole.depth_files, strict=True)
    ]
    for name in ("rgb.txt", "depth.txt", "associations.txt", "cam_params.json"):
        (tmp_path / name).unlink(missing_ok=True)
    (tmp_path / "calibration.txt").write_text("58 57 31.25 23.75\n")
    for order in (slice(None), slice(None, None, -1)):  # depth first, as some tools have it
        (tmp_path / "associations.txt").write_text("".join(" ".join(row[order]) + "\n" for row in rows))
        found = find_sequence(tmp_path)
        assert (found.rgb_files, found.depth_files) == (whole.rgb_files, whole.depth_files)
        assert found.stamps.depth.exact_ns == whole.stamps.depth.exact_ns
        assert np.array_equal(found.trajectory.c2w, whole.trajectory.c2w)
    assert intrinsics(found.known_camera) == (64, 48, 58, 57, 31.25, 23.75)
    (tmp_path / "calibration.txt").write_text("58 57 31.25\n")
    refused(find_sequence, tmp_path, names=("calibration.txt", "fx fy cx cy"))


TOLD_BY_POSES = {"icl_nuim", "nerfstudio", "colmap", "tartanair", "bop", "record3d", "polycam"}


@pytest.mark.parametrize("name", sorted(WRITERS.keys() - TOLD_BY_POSES))
def test_frames_are_kept_where_no_file_has_poses(name, tmp_path):
    WRITERS[name](tmp_path)
    for path in [path for path in tmp_path.rglob("*") if path.is_file()]:
        own = path.name in ("poses.txt", "groundtruth.txt")
        if own or path.name.endswith((".pose.txt", ".log", "-traj.txt")) or path.parent.name == "pose":
            path.unlink()
    if name == "redwood":  # which is told by its poses, or by the times in its images' names
        for path in [*tmp_path.glob("colors/*"), *tmp_path.glob("depth/*")]:
            path.rename(path.with_stem(f"{path.stem}-{path.stem}"))
    elif name == "scannet":
        (tmp_path / "pose").rmdir()
    refused(find_sequence, tmp_path, names="pose")
    kept = find_sequence(tmp_path, poses="keep")
    assert (len(kept.trajectory), kept.trajectory.known.any(), kept.trajectory_path) == (FRAMES, False, None)
    assert "4 of 4 frames have no valid pose; they are kept, and no pose is written for them" in kept.notes


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("cameras.txt", "1 THIN_PRISM_FISHEYE 64 48 1 2 3 4\n", ("line 1", "THIN_PRISM_FISHEYE", "FULL_OPENCV")),
        ("cameras.txt", "1 PINHOLE 64 48 60 60 32\n", ("3 parameters", "PINHOLE has fx, fy, cx, cy")),
        ("cameras.txt", "1 PINHOLE 64 48 60 60 32 24\n2 PINHOLE 64 48 61 60 32 24\n", ("2 cameras", "single_camera")),
        ("cameras.txt", "1 PINHOLE 64 48 60 nan 32 24\n", "no finite number"),
        ("images.txt", "1 1 0 0 0 0 0 0 3 other.png\n\n", ("images.txt", "other.png, which is not there")),
        ("images.txt", "1 1 0 0 0 0 0 3\n", "IMAGE_ID QW"),
        ("images.txt", "1 0 0 0 0 0 0 0 3 walk_8.png\n", "quaternion of zeros"),
    ],
)
def test_what_is_wrong_with_a_model_of_colmap(file, text, told, tmp_path):
    WRITERS["colmap"](tmp_path)
    (tmp_path / "sparse/0" / file).write_text(text)
    refused(find_sequence, tmp_path, names=told)


def test_a_model_of_colmap_in_its_binary_form_is_refused(tmp_path):
    WRITERS["colmap"](tmp_path)
    for path in sorted((tmp_path / "sparse/0").iterdir()):
        path.rename(path.with_suffix(".bin"))
    refused(find_sequence, tmp_path, names=("cameras.bin", "model_converter", "TXT"))


def test_a_lens_is_told(tmp_path):
    WRITERS["nerfstudio"](tmp_path)
    assert find_sequence(tmp_path).optics.distortion == Distortion("radial-tangential", (0.1, -0.05, 0.0, 0.0))


def test_redwood_images_named_by_time(tmp_path):
    c2w = poses()
    for n, (rgb_us, depth_us) in enumerate([(0, 28), (33369, 33400), (66741, 66750)]):
        image(tmp_path / f"rgb/{n + 1:07d}-{rgb_us:012d}.jpg", np.zeros((4, 4, 3), np.uint8))
        image(tmp_path / f"depth/{n + 1:07d}-{depth_us:012d}.png", np.full((4, 4), 1500, np.uint16))
    refused(find_sequence, tmp_path, names=("put a .log", "poses: none"))
    bare = find_sequence(tmp_path, poses="none")
    assert bare.stamps.rgb.ns == (0, 33_369_000, 66_741_000)
    assert bare.stamps.depth.ns == (28_000, 33_400_000, 66_750_000)
    (tmp_path / "a.log").write_text("".join(f"{n} {n} {n + 1}\n{text_of(c2w[n])}" for n in range(2)))
    found = find_sequence(tmp_path)
    assert np.abs(found.trajectory.c2w - c2w[:2]).max() < 1e-9
    assert find_sequence(tmp_path, poses="keep").trajectory.known.tolist() == [True, True, False]


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("intrinsic/intrinsic_color.txt", "1 2 3\n", "lines of four numbers"),
        ("intrinsic/intrinsic_color.txt", text_of(np.diag([0.0, 5, 1, 1])), "fx: is 0, but has to be above 0"),
        ("intrinsic/intrinsic_depth.txt", text_of(np.diag([5.0, 5, 1, 2])), "is no matrix of intrinsics"),
        ("intrinsic/extrinsic_depth.txt", text_of(np.diag([-1.0, -1, 1, 1])), "does not say where it leads"),
        ("pose/3.txt", "1 0 0 0\n0 1 0 0\n", "2 lines"),
        ("color/03.jpg", "", "3.jpg have one number"),
        ("color/99999999999999999999999.jpg", "", "large to count frames"),
    ],
)
def test_what_is_wrong_is_one_line(file, text, told, tmp_path):
    scannet(tmp_path)
    (tmp_path / file).write_text(text)
    refused(find_sequence, tmp_path, names=told)


def test_an_intrinsic_json_that_is_none(tmp_path):
    WRITERS["open3d"](tmp_path)
    path = tmp_path / "intrinsic.json"
    good = json.loads(path.read_text())
    for change, told in (
        ({"intrinsic_matrix": [1, 2]}, "nine numbers"),
        ({"depth_scale": 0}, ("depth_scale: ", "above 0")),
        ({"width": 64.5}, "width: has to be whole pixels"),
        ({"intrinsic_matrix": [5, 1, 0, 0, 5, 0, 2, 2, 1]}, "without skew"),
    ):
        path.write_text(json.dumps({**good, **change}))
        refused(find_sequence, tmp_path, names=told)


@pytest.mark.parametrize(("name", "file"), [("redwood", "intrinsic.txt"), ("seven_scenes", "camera-intrinsics.txt")])
def test_a_matrix_beside_the_frames_is_their_camera(name, file, tmp_path):
    folder = tmp_path / "seq-01"
    folder.mkdir()
    WRITERS[name](folder)
    assert find_sequence(folder).assumed
    for place in (tmp_path, folder):  # 3DMatch has it above its sequences
        path = place / file
        path.write_text("544.5 0 320.25\n0 543.5 240.75\n0 0 1\n")
        found = find_sequence(folder)
        assert intrinsics(found.known_camera) == (640, 480, 544.5, 543.5, 320.25, 240.75)
        assert (found.camera_path, found.assumed) == (path, "")
    path.write_text("544.5 0 320.25\n0 543.5 240.75\n")
    refused(find_sequence, folder, names=(f"{file}: ", "three lines of three"))
    path.write_text("544.5 1 320.25\n0 543.5 240.75\n0 0 1\n")
    refused(find_sequence, folder, names=(f"{file}: ", "a pinhole's matrix"))


def test_tum_as_the_benchmark_gives_it(tmp_path):
    folder = tmp_path / "rgbd_dataset_freiburg1_desk"
    stamps = ["1305031453.359684", "1305031453.391690", "1305031453.423683"]
    for stamp in stamps:
        image(folder / f"rgb/{stamp}.png", np.zeros((480, 640, 3), np.uint8))
    for stamp in ("1305031453.374112", "1305031453.404816"):
        image(folder / f"depth/{stamp}.png", np.full((480, 640), 5000, np.uint16))
    for name in ("rgb", "depth"):
        files = sorted((folder / name).iterdir())
        head = f"# {name}\n# file: 'rgbd_dataset_freiburg1_desk.bag'\n# timestamp filename\n"
        (folder / f"{name}.txt").write_text(head + "".join(f"{file.stem} {name}/{file.name}\n" for file in files))
    (folder / "accelerometer.txt").write_text("# accelerometer data\n1305031453.1 1 2 3\n")
    rows = [f"{1305031453.3552 + n / 100:.4f} {n}.5 1.0 2.0 0.0 0.0 0.0 1.0\n" for n in range(20)]
    (folder / "groundtruth.txt").write_text("".join(rows))
    found = find_sequence(folder)
    assert intrinsics(found.known_camera) == (640, 480, 517.3, 516.5, 318.6, 255.3)
    assert found.optics.distortion.coefficients == (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
    assert found.stamps.rgb.ns == (1305031453359684000, 1305031453391690000)
    assert found.trajectory.c2w[:, 0, 3].tolist() == [0.5, 4.5]
    assert found.notes == ("1 of 3 colour images are left out: 1 with no depth image within 0.02 s",)
    assert "calibration of this Kinect" in found.assumed
    folder.rename(tmp_path / "desk")
    assert find_sequence(tmp_path / "desk").known_camera is None


# --- images that are lost, and whose poses are whose ---

RECORDERS = {"open3d": ("color", "scene/trajectory.log"), "redwood": ("colors", "office1-traj.txt")}


def a_recording(folder, name, numbers, of_poses):
    """Write 6 frames with images of these numbers; the .log has poses `of_poses`, counted from 1. Return all poses."""
    c2w = poses(8, seed=21)
    colour, log = RECORDERS[name]
    for number in numbers:
        image(folder / f"{colour}/{number:05d}.png", np.zeros((4, 6, 3), np.uint8))
        image(folder / f"depth/{number:05d}.png", np.full((4, 6), 1500, np.uint16))
    (folder / "scene").mkdir(exist_ok=True)
    (folder / log).write_text("".join(f"{n} {n} {n + 1}\n{text_of(c2w[n])}" for n in of_poses))
    if name == "open3d":
        told = {"width": 6, "height": 4, "intrinsic_matrix": [5.0, 0, 0, 0, 5.0, 0, 2.5, 1.5, 1]}
        (folder / "intrinsic.json").write_text(json.dumps(told))
    return c2w


def posed(folder):
    """Return the number of each frame's image and its pose (N, 4, 4)."""
    found = find_sequence(folder)
    return [int(file.stem) for file in found.rgb_files], found.trajectory.c2w


@pytest.mark.parametrize("name", sorted(RECORDERS))
def test_an_image_that_is_lost_shifts_no_pose(name, tmp_path):
    colour = RECORDERS[name][0]
    c2w = a_recording(tmp_path, name, range(6), range(6))
    for lost in (f"{colour}/00000.png", f"{colour}/00003.png", "depth/00005.png"):
        (tmp_path / lost).unlink()
        numbers, found = posed(tmp_path)
        assert np.abs(found - c2w[numbers]).max() < 1e-9
    assert numbers == [1, 2, 4]
    assert "3 poses are left out: no frame has their number" in " ".join(find_sequence(tmp_path).notes)


@pytest.mark.parametrize(
    ("name", "numbers", "of_poses", "first"),
    [
        ("open3d", range(6), range(6), 0),
        ("open3d", range(6), range(4), 0),  # tracking ended
        ("open3d", range(4), range(6), 0),  # the last images are lost
        ("open3d", range(6), (2, 3, 4, 5), 0),  # tracking began late
        ("open3d", range(2, 6), range(6), 0),  # the first two frames are lost, colour and depth
        ("open3d", range(7, 13), range(6), 7),  # a part of a longer recording, tracked by itself
        ("open3d", (7, 8, 10, 11), range(4), (7, 8, 10, 11)),  # likewise, in which images were left out before
        ("redwood", range(6), range(6), 0),
        ("redwood", range(1, 7), range(6), 1),
        ("redwood", range(1, 7), range(4), 1),
        ("redwood", range(3, 7), range(6), 1),
        ("redwood", range(2, 6), range(6), 0),
        ("redwood", range(7, 13), range(6), 7),
    ],
)
def test_numbers_and_counts_tell_whose_a_pose_is(name, numbers, of_poses, first, tmp_path):
    c2w = a_recording(tmp_path, name, numbers, of_poses)
    images = range(first, first + 8) if isinstance(first, int) else first
    wanted = {images[place]: c2w[place] for place in of_poses if images[place] in numbers}
    found_numbers, found = posed(tmp_path)
    assert found_numbers == sorted(wanted)
    assert np.abs(found - [wanted[number] for number in found_numbers]).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "numbers", "of_poses"),
    [
        ("open3d", range(1, 7), range(4)),  # which images are lost, before or after?
        ("open3d", (0, 1, 3, 4, 5), range(5)),  # was it tracked without 2, or not to the end?
        ("redwood", range(1, 6), range(6)),  # numbered from 0 without the first, or from 1 without the last
        ("redwood", range(3, 5), range(6)),
    ],
)
def test_poses_that_may_be_of_several_images_are_refused(name, numbers, of_poses, tmp_path):
    a_recording(tmp_path, name, numbers, of_poses)
    refused(find_sequence, tmp_path, names=("which pose is whose", "put the images back"))
    assert len(find_sequence(tmp_path, poses="none").rgb_files) == len(numbers)


def test_a_log_that_counts_far_is_one_line(tmp_path):
    a_recording(tmp_path, "open3d", range(3), range(3))
    log = tmp_path / "scene/trajectory.log"
    log.write_text(log.read_text().replace("2 2 3\n", f"2 2 {2**52}\n"))
    assert posed(tmp_path)[0] == [0, 1]


def test_redwood_images_named_by_time_and_a_lost_one(tmp_path):
    c2w = poses()
    for n in range(4):
        image(tmp_path / f"rgb/{n + 1:07d}-{33_000 * n:012d}.png", np.zeros((4, 4, 3), np.uint8))
        image(tmp_path / f"depth/{n + 1:07d}-{33_000 * n + 20:012d}.png", np.full((4, 4), 1500, np.uint16))
    (tmp_path / "a.log").write_text("".join(f"{n} {n} {n + 1}\n{text_of(c2w[n])}" for n in range(4)))
    (tmp_path / f"rgb/0000003-{66_000:012d}.png").unlink()
    assert np.abs(find_sequence(tmp_path).trajectory.c2w - c2w[[0, 1, 3]]).max() < 1e-9
    (tmp_path / f"rgb/0000001-{0:012d}.png").unlink()
    assert np.abs(find_sequence(tmp_path).trajectory.c2w - c2w[[1, 3]]).max() < 1e-9


@pytest.mark.parametrize(("name", "shifted"), [("scannet", "depth"), ("scannet", "pose"), ("seven_scenes", "pose")])
def test_files_that_are_numbered_from_another_number_on_are_refused(name, shifted, tmp_path):
    WRITERS[name](tmp_path)
    files = tmp_path.glob(f"{shifted}/*") if name == "scannet" else tmp_path.glob(f"*.{shifted}.*")
    for path in sorted(files, reverse=True):
        digits = re.search("[0-9]+", path.name)[0]
        path.rename(path.with_name(path.name.replace(digits, f"{int(digits) + 1:0{len(digits)}d}")))
    refused(find_sequence, tmp_path, names=("colour images 0 to 3 ", " 1 to 4"))


@pytest.mark.parametrize(
    ("name", "file", "text", "told"),
    [
        (
            "tartanair",
            "pose_left.txt",
            "0 0 0 0 0 0 1\n" * 3,
            ("pose_left.txt", "poses of 3 frames", "4 images", "a pose for each image"),
        ),
        ("tartanair", "pose_left.txt", "0 0 0 0 0 0 2\n" * 4, ("line 1", "length 2, not 1", "tx ty tz qx qy qz qw")),
        ("neural_rgbd", "focal.txt", "inf\n", ("focal.txt", "above 0, the focal length")),
        ("neural_rgbd", "focal.txt", "500 500\n", ("focal.txt", "one number")),
        ("neural_rgbd", "poses.txt", "nan nan nan nan\n" * 16, ("poses.txt", "no pose")),
        ("bop", "scene_camera.json", "{}", ("scene_camera.json", "by the number of each image")),
        ("bop", "scene_camera.json", '{"3": {"cam_K": [1, 2]}}', ("3.cam_K", "3 x 3")),
        ("record3d", "metadata.json", "[]", ("metadata.json", "no mapping")),
        ("record3d", "metadata.json", '{"poses": [[0, 0, 0, 1, 0, 0]]}', ("poses", "7 numbers")),
        ("polycam", "keyframes/cameras/113906155183.json", "{}", ("113906155183.json", "width")),
        ("openloris", "sensors.yaml", "%YAML:1.0\nx: 1\n", ("sensors.yaml", "d400_color_optical_frame", "missing")),
        ("openloris", "trans_matrix.yaml", "trans_matrix: []\n", ("trans_matrix.yaml", "base_link")),
    ],
)
def test_what_is_wrong_with_what_tools_write_is_one_line(name, file, text, told, tmp_path):
    WRITERS[name](tmp_path)
    (tmp_path / file).write_text(text)
    refused(find_sequence, tmp_path, names=told)


def rewritten(path, change):
    """Change a JSON file's document in place."""
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


TURNED = [0, 1, 0, 1, 0, 0, 0, 0, 1]  # x and y swapped: a mirror
WRONG_KEYS = [
    ("bop", "scene_camera.json", lambda d: d["4"].update(depth_scale=1.0), ("several depth_scale", "apart")),
    ("bop", "scene_camera.json", lambda d: d["5"].update(cam_R_w2c=TURNED), "5.cam_R_w2c: is no rotation"),
    ("bop", "scene_camera.json", lambda d: d["5"].update(cam_t_w2c=[1, 2]), "5.cam_t_w2c: is no three numbers"),
    ("record3d", "metadata.json", lambda d: d.update(w=65), ("65 x 48, but these are 64 x 48", "belong to it")),
    ("record3d", "metadata.json", lambda d: d["poses"][2].__setitem__(0, 3.0), "poses.2: holds no unit quaternion"),
    ("record3d", "metadata.json", lambda d: d.update(frameTimestamps=[1, 2, 2, 3]), "frameTimestamps: has to hold"),
    ("record3d", "metadata.json", lambda d: d.update(frameTimestamps=[1, 2, "x", 3]), "frameTimestamps: has to hold"),
    ("record3d", "metadata.json", lambda d: d.update(fps=-60), "fps: is -60, but has to be frames a second"),
    ("record3d", "metadata.json", lambda d: d.update(perFrameIntrinsicCoeffs=[[1, 2]]), "4 numbers each"),
    (
        "polycam",
        "keyframes/cameras/113906155216.json",
        lambda d: d.update(t_00=2.0),
        ("113906155216.json", "t_00 to t_23 are no pose", "as Polycam writes it"),
    ),
    ("nerfstudio", "transforms.json", lambda d: d.update(frames={}), ("frames: is no list", "as nerfstudio writes it")),
    ("nerfstudio", "transforms.json", lambda d: d["frames"][0].pop("file_path"), "names no colour image"),
    ("nerfstudio", "transforms.json", lambda d: d["frames"][1].update(depth_file_path=""), "names no depth image"),
    ("nerfstudio", "transforms.json", lambda d: d.pop("fl_x"), ("fl_x: is missing", "w, h, fl_x")),
    (
        "nerfstudio",
        "transforms.json",
        lambda d: [d.pop(key, None) for key in ("w", "h", "fl_x", "fl_y", "cx", "cy")],
        ("fl_x: is missing", "a camera has w, h, fl_x"),
    ),
    ("nerfstudio", "transforms.json", lambda d: d.update(k1="wide"), "k1: "),
    (
        "nerfstudio",
        "transforms.json",
        lambda d: [frame.update(p2=0.01 * row) for row, frame in enumerate(d["frames"])] and d.pop("p2", None),
        ("frames.1.p2: is 0.01, but an earlier frame's is 0.0", "one camera"),
    ),
    ("nerfstudio", "transforms.json", lambda d: d.update(camera_model="PINHOLE"), "PINHOLE has no such coefficient"),
    ("nerfstudio", "transforms.json", lambda d: d.update(k4=0.5), "k4: is 0.5, but OPENCV has no such coefficient"),
]


@pytest.mark.parametrize(("name", "file", "change", "told"), WRONG_KEYS)
def test_one_wrong_key_of_a_file_of_json_is_named(name, file, change, told, tmp_path):
    WRITERS[name](tmp_path)
    rewritten(tmp_path / file, change)
    refused(find_sequence, tmp_path, names=(file.rsplit("/", 1)[-1], *([told] if isinstance(told, str) else told)))


IDENTITY = "[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]"
SENSORS = "d400_color_optical_frame: {width: 64, height: 48, intrinsics: {data: [58, 31, 57]}}\n"


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("trans_matrix.yaml", "trans_matrix: [3]\n", "trans_matrix.0: is no mapping"),
        (
            "trans_matrix.yaml",
            f"trans_matrix: [{{matrix: {{data: {IDENTITY.replace('1', '2')}}}}}]\n",
            "trans_matrix.0.matrix: is no pose",
        ),
        (
            "trans_matrix.yaml",
            f"trans_matrix: [{{child_frame: mast, parent_frame: base_link, matrix: {{data: {IDENTITY}}}}}]\n",
            "does not lead from base_link to d400_color_optical_frame",
        ),
        ("sensors.yaml", SENSORS, "d400_color_optical_frame.intrinsics: is no matrix of 4 numbers"),
        ("sensors.yaml", "[1, 2]\n", "sensors.yaml: "),
    ],
)
def test_what_is_wrong_with_a_robots_sensors_is_named(file, text, told, tmp_path):
    WRITERS["openloris"](tmp_path)
    (tmp_path / file).write_text(text)
    refused(find_sequence, tmp_path, names=(file, told))


def test_a_robots_camera_without_coefficients_has_no_lens(tmp_path):
    WRITERS["openloris"](tmp_path)
    data = "data: [58, 31.25, 57, 23.75]"
    (tmp_path / "sensors.yaml").write_text(SENSORS.replace("data: [58, 31, 57]", data))
    found = find_sequence(tmp_path)
    assert found.optics.distortion is None
    assert intrinsics(found.known_camera) == (64, 48, 58.0, 57.0, 31.25, 23.75)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("m_depthShift = 1000", "m_depthShift = -5", "m_depthShift: is -5, but has to be above 0"),
        ("m_depthShift = 1000", "m_depthShift = mm", ("m_depthShift: is no number", "as SensReader")),
        ("m_depthWidth = 32\n", "", ("m_depthWidth: is missing", "as SensReader")),
        (
            "m_calibrationColorExtrinsic = 1 0 0 0 ",
            "m_calibrationColorExtrinsic = 1 0 0 0.02 ",
            ("m_calibrationColorExtrinsic: is not the identity", "register depth to colour"),
        ),
    ],
)
def test_what_is_wrong_with_a_calibration_of_bundlefusion_is_named(old, new, told, tmp_path):
    WRITERS["bundlefusion"](tmp_path)
    path = tmp_path / "info.txt"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    refused(find_sequence, tmp_path, names=("info.txt", *([told] if isinstance(told, str) else told)))


def test_an_image_of_bop_that_has_no_pose_is_left_out(tmp_path):
    written = WRITERS["bop"](tmp_path)
    rewritten(tmp_path / "scene_camera.json", lambda document: document["4"].pop("cam_t_w2c"))
    found = find_sequence(tmp_path)
    assert [file.stem for file in found.rgb_files] == ["000003", "000005", "000006"]
    assert np.abs(found.trajectory.c2w - written.c2w[[0, 2, 3]]).max() < 1e-9


def test_an_image_of_polycam_that_has_no_camera_is_left_out_and_one_has_to_have_it(tmp_path):
    written = WRITERS["polycam"](tmp_path)
    cameras = sorted((tmp_path / "keyframes/cameras").iterdir())
    cameras[1].unlink()
    found = find_sequence(tmp_path)
    assert [file.stem for file in found.rgb_files] == [cameras[row].stem for row in (0, 2, 3)]
    assert np.abs(found.trajectory.c2w - written.c2w[[0, 2, 3]]).max() < 1e-9
    for row in (0, 2, 3):
        cameras[row].rename(cameras[row].with_name(f"other{row}.json"))
    refused(find_sequence, tmp_path, names=("cameras: has no camera of an image", "as Polycam exports raw data"))


def test_record3d_may_say_a_camera_and_a_time_of_each_frame(tmp_path):
    WRITERS["record3d"](tmp_path)
    rows = [[60.9, 60.5, 31.25, 23.75], *[[61.0, 60.5, 31.25, 23.75]] * 2, [61.1, 60.5, 31.25, 23.75]]
    told = {"perFrameIntrinsicCoeffs": rows, "frameTimestamps": [5.0, 5.125, 5.5, 6.0]}
    rewritten(tmp_path / "metadata.json", lambda document: document.update(told))
    found = find_sequence(tmp_path)
    assert intrinsics(found.known_camera) == (64, 48, 61.0, 60.5, 31.25, 23.75)  # the middle of them
    assert found.stamps.rgb.seconds.tolist() == [5.0, 5.125, 5.5, 6.0]


def test_a_model_of_colmap_names_an_image_once(tmp_path):
    WRITERS["colmap"](tmp_path)
    path = tmp_path / "sparse/0/images.txt"
    path.write_text("1 1 0 0 0 0 0 0 3 walk_8.png\n\n" * 2)
    refused(find_sequence, tmp_path, names=("images.txt: walk_8.png has 2 lines", "keep one of them"))


def test_a_fisheye_of_colmap_is_equidistant(tmp_path):
    WRITERS["colmap"](tmp_path)
    path = tmp_path / "sparse/0/cameras.txt"
    path.write_text("3 OPENCV_FISHEYE 64 48 61.0 60.5 31.75 24.25 0.1 -0.02 0.003 -0.0004\n")
    found = find_sequence(tmp_path)
    assert found.optics.distortion == Distortion("equidistant", (0.1, -0.02, 0.003, -0.0004))
    assert intrinsics(found.known_camera) == (64, 48, 61.0, 60.5, 31.25, 23.75)
    path.write_text("3 PINHOLE 64 48 61.0 60.5 wide 24.25\n")
    refused(find_sequence, tmp_path, names=("cameras.txt: line 1: ", "no finite number"))


@pytest.mark.parametrize(("name", "rows"), [("colmap", [0, 1, 3]), ("nerfstudio", None)])
def test_the_poses_of_a_written_sequence_are_read_alone_and_counted(name, rows, tmp_path):
    written = WRITERS[name](tmp_path)
    expected = written.c2w if rows is None else written.c2w[rows]
    if name == "nerfstudio":  # ours lists frames in their order, others in any
        rewritten(tmp_path / "transforms.json", lambda document: document["frames"].reverse())
    layout = LAYOUTS[name]
    assert np.abs(layout.poses_file(tmp_path)[1] - expected).max() < 1e-9
    assert np.abs(layout.written_poses(tmp_path, np.arange(len(expected))) - expected).max() < 1e-9
    refused(layout.written_poses, tmp_path, np.arange(7.0), names=f"has {len(expected)} poses for 7 frames")


@pytest.mark.parametrize(("name", "rational"), [("colmap", True), ("nerfstudio", False)])
def test_which_lenses_a_layout_can_say(name, rational):
    """COLMAP has FULL_OPENCV of eight coefficients; transforms.json has no key for the last three."""
    longest = Distortion("radial-tangential", (0.1, 0.01, 0.0, 0.0, 0.001, 0.2, 0.02, 0.002))
    assert LAYOUTS[name].says_lens(longest) is rational
    assert LAYOUTS[name].says_lens(Distortion("equidistant", (0.1, 0.0, 0.0, 0.0)))


def test_a_scale_beside_a_recording_of_others_leaves_its_camera(tmp_path):
    WRITERS["nerfstudio"](tmp_path)
    before = find_sequence(tmp_path)
    (tmp_path / "cam_params.json").write_text('{"camera": {"scale": 4000}}')
    found = find_sequence(tmp_path)
    assert (found.depth_scale_per_m, found.known_camera) == (4000, before.known_camera)
    assert found.optics == before.optics
