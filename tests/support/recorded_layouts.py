# SPDX-License-Identifier: GPL-3.0-or-later
"""Recordings as others write them, of a box seen from inside: each at its own conventions, by its own arithmetic."""

import json
from dataclasses import dataclass

import cv2
import numpy as np
import OpenEXR
from scipy.spatial.transform import Rotation

HALF_M = np.array([2.0, 1.5, 1.2])  # of the box's sides; symmetric, so that it may be mirrored
FRAMES = 4


@dataclass(frozen=True)
class Written:
    """What a recording holds. c2w: (N, 4, 4), OpenCV's axes; NaN where a pose is lost. steps: depth of each frame."""

    c2w: np.ndarray
    steps: list
    scale_per_m: float
    depth_k: tuple
    colour_k: tuple
    numbers: tuple = tuple(range(FRAMES))
    hz: float = 30.0
    lost: tuple = ()


def poses(count=FRAMES, seed=0):
    """Poses that look about the same way, each a little turned, so that frames see the same places."""
    random = np.random.default_rng(seed)
    c2w = np.tile(np.eye(4), (count, 1, 1))
    little = Rotation.from_rotvec(random.uniform(-0.2, 0.2, (count, 3)))
    c2w[:, :3, :3] = (Rotation.random(None, random) * little).as_matrix()
    c2w[:, :3, 3] = random.uniform(-0.5, 0.5, (count, 3)) * HALF_M
    return c2w


def box_depth_m(k, c2w):
    """Planar depth of the box by slabs. k: width, height, fx, fy, cx, cy; a negative fy is a camera with y up."""
    wide, high, fx, fy, cx, cy = k
    u, v = np.meshgrid(np.arange(wide), np.arange(high))
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u, dtype=float)], axis=-1) @ c2w[:3, :3].T
    with np.errstate(divide="ignore"):
        return (np.where(rays > 0, HALF_M - c2w[:3, 3], -HALF_M - c2w[:3, 3]) / rays).min(axis=-1)


def text_of(matrix):
    return "".join(" ".join(f"{value:.17g}" for value in row) + "\n" for row in matrix)


def image(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), pixels)


def colour(k, frame):
    pixels = np.zeros((k[1], k[0], 3), np.uint8)
    pixels[...] = (10 * frame, 100, 200)  # BGR
    return pixels


def _steps(k, c2w, scale, void=0):
    steps = [np.rint(box_depth_m(k, one) * scale).astype(np.uint16) for one in c2w]
    for one in steps:
        one[:2, :3] = void
    return steps


def seven_scenes(folder, suffix="png"):
    k = (640, 480, 585.0, 585.0, 320.0, 240.0)
    c2w = poses()
    steps = _steps(k, c2w, 1000.0, void=65535)
    for n in range(FRAMES):
        image(folder / f"frame-{n:06d}.color.{suffix}", colour(k, n))
        image(folder / f"frame-{n:06d}.depth.png", steps[n])
        (folder / f"frame-{n:06d}.pose.txt").write_text("\t ".join(text_of(c2w[n]).split(" ")))
    return Written(c2w, steps, 1000.0, k, k)


def bundlefusion(folder):
    rgb, seen = (64, 48, 58.0, 59.0, 32.0, 24.0), (32, 24, 29.5, 30.0, 15.5, 12.0)
    c2w = poses(seed=1)
    steps = _steps(seen, c2w, 1000.0)
    for n in range(FRAMES):
        image(folder / f"frame-{n:06d}.color.jpg", colour(rgb, n))
        image(folder / f"frame-{n:06d}.depth.png", steps[n])
        lost = np.full((4, 4), -np.inf)
        (folder / f"frame-{n:06d}.pose.txt").write_text(text_of(lost if n == 2 else c2w[n]))
    lines = ["m_versionNumber = 4", "m_sensorName = StructureSensor", "m_depthShift = 1000"]
    for kind, (wide, high, fx, fy, cx, cy) in (("color", rgb), ("depth", seen)):
        lines += [f"m_{kind}Width = {wide}", f"m_{kind}Height = {high}"]
        lines += [f"m_calibration{kind.capitalize()}Intrinsic = {fx} 0 {cx} 0 0 {fy} {cy} 0 0 0 1 0 0 0 0 1 "]
        lines += [f"m_calibration{kind.capitalize()}Extrinsic = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 "]
    (folder / "info.txt").write_text("\n".join([*lines, "m_frames.size = 4", ""]))
    return Written(c2w, steps, 1000.0, seen, rgb, lost=(2,))


def scannet(folder):
    rgb, seen = (64, 48, 58.5, 59.0, 32.25, 24.5), (32, 24, 28.5, 28.75, 16.0, 11.5)
    c2w = poses(seed=2)
    steps = _steps(seen, c2w, 1000.0)
    for n in range(FRAMES):
        image(folder / f"color/{n}.jpg", colour(rgb, n))
        image(folder / f"depth/{n}.png", steps[n])
        (folder / "pose").mkdir(exist_ok=True)
        (folder / f"pose/{n}.txt").write_text(text_of(np.full((4, 4), -np.inf) if n == 1 else c2w[n]))
    (folder / "intrinsic").mkdir()
    for kind, (_, _, fx, fy, cx, cy) in (("color", rgb), ("depth", seen)):
        matrix = np.diag([fx, fy, 1.0, 1.0])
        matrix[:2, 2] = cx, cy
        (folder / f"intrinsic/intrinsic_{kind}.txt").write_text(text_of(matrix))
        (folder / f"intrinsic/extrinsic_{kind}.txt").write_text(text_of(np.eye(4)))
    return Written(c2w, steps, 1000.0, seen, rgb, lost=(1,))


def icl_nuim(folder):
    left = (640, 480, 481.2, -480.0, 319.5, 239.5)  # as the dataset says it
    c2w = poses(seed=3)
    steps = _steps(left, c2w, 5000.0)
    pairs, truth = [], []
    for n in range(FRAMES):
        image(folder / f"rgb/{n}.png", colour(left, n))
        image(folder / f"depth/{n}.png", steps[n])
        pairs.append(f"{n} depth/{n}.png {n} rgb/{n}.png\n")
        if n:  # the first frame has no pose
            xyzw = Rotation.from_matrix(c2w[n, :3, :3]).as_quat()
            truth.append(" ".join([str(n), *map(repr, [*c2w[n, :3, 3].tolist(), *xyzw.tolist()])]) + "\n")
    (folder / "associations.txt").write_text("".join(pairs))
    (folder / "livingRoom0.gt.freiburg").write_text("".join(truth))
    flip = np.diag([1.0, -1.0, 1.0, 1.0])
    return Written(flip @ c2w @ flip, steps, 5000.0, (640, 480, 481.2, 480.0, 319.5, 239.5), left, lost=(0,))


def open3d(folder):
    k = (64, 48, 61.0, 60.5, 31.25, 23.75)
    c2w = poses(seed=4)
    steps = _steps(k, c2w, 4000.0)
    for n in range(FRAMES):
        image(folder / f"color/{n:05d}.jpg", colour(k, n))
        image(folder / f"depth/{n:05d}.png", steps[n])
    columns = [k[2], 0, 0, 0, k[3], 0, k[4], k[5], 1]
    told = {"width": 64, "height": 48, "intrinsic_matrix": columns, "fps": 15.0, "depth_scale": 4000.0}
    (folder / "intrinsic.json").write_text(json.dumps({**told, "device_name": "Intel RealSense D435"}))
    (folder / "scene").mkdir()
    log = "".join(f"{n} {n} {n + 1}\n{text_of(c2w[n])}" for n in range(FRAMES))
    (folder / "scene/trajectory.log").write_text(log)
    return Written(c2w, steps, 4000.0, k, k, hz=15.0)


def redwood(folder):
    k = (640, 480, 525.0, 525.0, 319.5, 239.5)
    c2w = poses(seed=5)
    steps = _steps(k, c2w, 1000.0)
    for n in range(FRAMES):
        image(folder / f"colors/{n + 7:05d}.jpg", colour(k, n))
        image(folder / f"depth/{n + 7:05d}.png", steps[n])
    log = "".join(f"{n} {n} {n + 1}\n{text_of(c2w[n])}" for n in range(FRAMES))
    (folder / "office1-traj.txt").write_text(log)
    return Written(c2w, steps, 1000.0, k, k, numbers=(7, 8, 9, 10))


def nerfstudio(folder):
    rgb = (64, 48, 61.0, 60.5, 31.25, 23.75)
    # Depth shows the same view in a quarter of the pixels a side: corners scale with it, and centres do not.
    seen = (16, 12, 61.0 / 4, 60.5 / 4, (31.25 + 0.5) / 4 - 0.5, (23.75 + 0.5) / 4 - 0.5)
    c2w = poses(seed=6)
    steps = _steps(seen, c2w, 1000.0)
    frames = []
    for n in range(FRAMES):
        image(folder / f"images/frame_{n + 1}.png", colour(rgb, n))
        image(folder / f"depths/frame_{n + 1}.png", steps[n])
        opengl = c2w[n] * np.array([1.0, -1.0, -1.0, 1.0])
        names = {"file_path": f"images/frame_{n + 1}.png", "depth_file_path": f"depths/frame_{n + 1}.png"}
        frames.append({**names, "transform_matrix": opengl.tolist()})
    told = {"w": 64, "h": 48, "fl_x": 61.0, "fl_y": 60.5, "cx": 31.75, "cy": 24.25, "k1": 0.1, "k2": -0.05}
    (folder / "transforms.json").write_text(json.dumps({**told, "camera_model": "OPENCV", "frames": frames[::-1]}))
    return Written(c2w, steps, 1000.0, seen, rgb)


def colmap(folder):
    """Images by names that no number pads; one has no pose, and points stand in the other lines."""
    k = (64, 48, 61.0, 60.5, 31.25, 23.75)
    c2w = poses(seed=13)
    steps = _steps(k, c2w, 1000.0)
    rows = ["# Image list with two lines of data per image:"]
    for n in range(FRAMES):
        image(folder / f"images/walk_{n + 8}.png", colour(k, n))
        image(folder / f"depth/walk_{n + 8}.png", steps[n])
        if n != 2:
            w2c = np.linalg.inv(c2w[n])
            x, y, z, w = Rotation.from_matrix(w2c[:3, :3]).as_quat().tolist()
            numbers = " ".join(map(repr, [w, x, y, z, *w2c[:3, 3].tolist()]))
            rows += [f"{9 - n} {numbers} 3 walk_{n + 8}.png", "" if n else "1.5 2.5 -1 3.5 4.5 7"]
    (folder / "sparse/0").mkdir(parents=True)
    (folder / "sparse/0/images.txt").write_text("\n".join([*rows[:1], *rows[3:], *rows[1:3], ""]))
    camera = "3 OPENCV 64 48 61.0 60.5 31.75 24.25 0 0 0 0"  # pixels' corners are at whole coordinates
    (folder / "sparse/0/cameras.txt").write_text(f"# Camera list\n{camera}\n")
    return Written(c2w, steps, 1000.0, k, k, lost=(2,))


def tartanair(folder):
    """Camera and world are an aircraft's: x forward, y right, z down; depth is float32 in metres."""
    k = (640, 480, 320.0, 320.0, 320.0, 240.0)
    c2w = poses(seed=13)
    steps = _steps(k, c2w, 1000.0)
    ned_from_camera = np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    ned_from_up = np.diag([1.0, -1.0, -1.0, 1.0])
    (folder / "depth_left").mkdir()
    lines = []
    for n in range(FRAMES):
        image(folder / f"image_left/{n:06d}_left.png", colour(k, n))
        np.save(folder / f"depth_left/{n:06d}_left_depth.npy", (steps[n] / 1000).astype(np.float32))
        body = ned_from_up @ c2w[n] @ np.linalg.inv(ned_from_camera)
        row = [*body[:3, 3].tolist(), *Rotation.from_matrix(body[:3, :3]).as_quat().tolist()]
        lines.append(" ".join(map(repr, row)) + "\n")
    (folder / "pose_left.txt").write_text("".join(lines))
    return Written(c2w, steps, 1000.0, k, k)


def neural_rgbd(folder):
    """Poses have OpenGL's axes, one is lost; rays go through half-numbered pixels, around the middle."""
    k = (64, 48, 57.5, 57.5, 31.5, 23.5)
    c2w = poses(seed=14)
    steps = _steps(k, c2w, 1000.0)
    texts = []
    for n in range(FRAMES):
        image(folder / f"images/img{n}.png", colour(k, n))
        image(folder / f"depth/depth{n}.png", steps[n])
        opengl = c2w[n] * np.array([1.0, -1.0, -1.0, 1.0])
        texts.append(text_of(np.full((4, 4), np.nan) if n == 3 else opengl))
    (folder / "poses.txt").write_text("".join(texts))
    (folder / "focal.txt").write_text("57.5\n")
    return Written(c2w, steps, 1000.0, k, k, lost=(3,))


def bop(folder):
    """World-to-camera, in millimetres; depth in tenths of a millimetre; images are numbered from 3 on."""
    k = (64, 48, 58.0, 57.0, 31.25, 23.75)
    c2w = poses(seed=15)
    steps = _steps(k, c2w, 10_000.0)
    told = {}
    for n in range(FRAMES):
        image(folder / f"rgb/{n + 3:06d}.jpg", colour(k, n))
        image(folder / f"depth/{n + 3:06d}.png", steps[n])
        w2c = np.linalg.inv(c2w[n])
        matrix = [k[2], 0.0, k[4], 0.0, k[3], k[5], 0.0, 0.0, 1.0]
        pose = {"cam_R_w2c": w2c[:3, :3].ravel().tolist(), "cam_t_w2c": (1000 * w2c[:3, 3]).tolist()}
        told[str(n + 3)] = {"cam_K": matrix, "depth_scale": 0.1, **pose}
    (folder / "scene_camera.json").write_text(json.dumps(told))
    return Written(c2w, steps, 10_000.0, k, k, numbers=(3, 4, 5, 6))


def _arkit(c2w):
    """A pose of ARKit: x right, y up, z backward in the camera, and a world whose y is up where ours has z up."""
    return (
        np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]]) @ c2w * np.array([1.0, -1.0, -1.0, 1.0])
    )


def record3d(folder):
    """Depth is half floats' EXR in metres, of a quarter of the pixels a side."""
    rgb = (64, 48, 61.0, 60.5, 31.25, 23.75)
    seen = (16, 12, 61.0 / 4, 60.5 / 4, (31.25 + 0.5) / 4 - 0.5, (23.75 + 0.5) / 4 - 0.5)
    c2w = poses(seed=16)
    steps = _steps(seen, c2w, 1000.0)
    rows = []
    (folder / "depth").mkdir()
    for n in range(FRAMES):
        image(folder / f"rgb/{n}.jpg", colour(rgb, n))
        values = {"R": (steps[n] / 1000).astype(np.float32)}
        OpenEXR.File({"type": OpenEXR.scanlineimage}, values).write(str(folder / f"depth/{n}.exr"))
        rows.append([*_quaternion(_arkit(c2w[n]), "xyzw"), *_arkit(c2w[n])[:3, 3].tolist()])
    columns = [rgb[2], 0, 0, 0, rgb[3], 0, rgb[4], rgb[5], 1]
    told = {"w": 64, "h": 48, "fps": 60, "K": columns, "poses": rows}
    (folder / "metadata.json").write_text(json.dumps(told))
    return Written(c2w, steps, 1000.0, seen, rgb, hz=60.0)


def polycam(folder):
    """Frames are named by large numbers; their focal lengths differ by a tenth of a pixel."""
    rgb = (64, 48, 61.0, 60.5, 31.25, 23.75)
    seen = (16, 12, 61.0 / 4, 60.5 / 4, (31.25 + 0.5) / 4 - 0.5, (23.75 + 0.5) / 4 - 0.5)
    c2w = poses(seed=17)
    steps = _steps(seen, c2w, 1000.0)
    (folder / "keyframes/cameras").mkdir(parents=True)
    for n in range(FRAMES):
        name = 113_906_155_183 + 33 * n
        image(folder / f"keyframes/images/{name}.jpg", colour(rgb, n))
        image(folder / f"keyframes/depth/{name}.png", steps[n])
        matrix = _arkit(c2w[n])
        told = {f"t_{row}{column}": float(matrix[row, column]) for row in range(3) for column in range(4)}
        focal = {"fx": rgb[2] + (0.05, 0, 0, -0.05)[n], "fy": rgb[3], "cx": rgb[4], "cy": rgb[5]}
        text = json.dumps({**told, **focal, "width": 64, "height": 48, "blur_score": 90.0})
        (folder / f"keyframes/cameras/{name}.json").write_text(text)
    return Written(c2w, steps, 1000.0, seen, rgb)


def openloris(folder):
    """Poses are those of the robot's base; intrinsics are fx cx fy cy, and FileStorage tags its matrices."""
    k = (64, 48, 58.0, 57.0, 31.25, 23.75)
    c2w = poses(seed=18)
    steps = _steps(k, c2w, 1000.0)
    base_from_mast, mast_from_camera = poses(2, seed=98)
    base = c2w @ np.linalg.inv(base_from_mast @ mast_from_camera)
    lists = {"color": [], "aligned_depth": [], "groundtruth": []}
    for n in range(FRAMES):
        at = f"{1560004885 + n}.446172"
        for kind, pixels in (("color", colour(k, n)), ("aligned_depth", steps[n])):
            image(folder / f"{kind}/{at}.png", pixels)
            lists[kind].append(f"{at} {kind}/{at}.png")
        lists["groundtruth"].append(
            " ".join([at, *map(repr, [*base[n, :3, 3].tolist(), *_quaternion(base[n], "xyzw")])])
        )
    for name, rows in lists.items():
        (folder / f"{name}.txt").write_text("#Time data\n" + "".join(row + "\n" for row in rows))
    storage = cv2.FileStorage(str(folder / "sensors.yaml"), cv2.FILE_STORAGE_WRITE)
    storage.startWriteStruct("d400_color_optical_frame", cv2.FileNode_MAP)
    for name, value in (("fps", 30), ("width", 64), ("height", 48), ("distortion_model", "radial-tangential")):
        storage.write(name, value)
    storage.write("intrinsics", np.array([[k[2], k[4], k[3], k[5]]]))
    storage.write("distortion_coefficients", np.zeros((1, 5)))
    storage.endWriteStruct()
    storage.release()
    storage = cv2.FileStorage(str(folder / "trans_matrix.yaml"), cv2.FILE_STORAGE_WRITE)
    storage.startWriteStruct("trans_matrix", cv2.FileNode_SEQ)
    for parent, child, matrix in (
        ("mast", "d400_color_optical_frame", mast_from_camera),
        ("base_link", "mast", base_from_mast),
    ):
        storage.startWriteStruct("", cv2.FileNode_MAP)
        storage.write("parent_frame", parent)
        storage.write("child_frame", child)
        storage.write("matrix", matrix)
        storage.endWriteStruct()
    storage.endWriteStruct()
    storage.release()
    seconds = tuple(1560004885.446172 + n for n in range(FRAMES))
    return Written(c2w, steps, 1000.0, k, k, numbers=seconds, hz=1.0)


def rgbd_folders(folder):
    """Colour and depth of one name, and nothing else."""
    k = (33, 25, 30.0, 29.0, 15.5, 12.25)
    c2w = poses(seed=19)
    steps = _steps(k, c2w, 1000.0)
    for n in range(FRAMES):
        image(folder / f"rgb/{n}.png", colour(k, n))
        image(folder / f"depth/{n}.png", steps[n])
    return Written(c2w, steps, 1000.0, k, k, lost=tuple(range(FRAMES)))


# --- the layouts that Noisy World writes, as others write them ---

START_NS = 1403636579763555584


def kitti(folder):
    """The left colour camera sits 6 cm to the right of camera 0, whose poses the benchmark has; there is no depth."""
    k = (64, 48, 61.0, 60.5, 31.25, 23.75)
    c2w = poses(seed=12)
    beside_m = np.array([0.06, -0.002, 0.003])
    matrix = np.array([[k[2], 0, k[4]], [0, k[3], k[5]], [0, 0, 1]])
    lines = []
    for n, one in enumerate(c2w):
        image(folder / f"image_2/{n:06d}.png", colour(k, n))
        of_camera_0 = one[:3].copy()
        of_camera_0[:, 3] -= one[:3, :3] @ beside_m
        lines.append(" ".join(map(repr, of_camera_0.ravel().tolist())) + "\n")
    (folder / "poses.txt").write_text("".join(lines))
    (folder / "times.txt").write_text("".join(f"{0.1036 * n:.6e}\n" for n in range(FRAMES)))
    projections = {"P0": np.zeros(3), "P2": -matrix @ beside_m}
    rows = {name: np.column_stack([matrix, last]).ravel().tolist() for name, last in projections.items()}
    (folder / "calib.txt").write_text("".join(f"{name}: {' '.join(map(repr, row))}\n" for name, row in rows.items()))
    return Written(c2w, [], 1000.0, k, k)


def _stamps_ns():
    return [START_NS + n * 33_333_333 for n in range(FRAMES)]


def _quaternion(c2w, order):
    x, y, z, w = Rotation.from_matrix(c2w[:3, :3]).as_quat().tolist()
    return [w, x, y, z] if order == "wxyz" else [x, y, z, w]


def replica(folder):
    k = (64, 48, 58.0, 57.0, 31.5, 23.5)
    c2w = poses(seed=7)
    steps = _steps(k, c2w, 6553.5)
    for n in range(FRAMES):
        image(folder / f"results/frame{n:06d}.jpg", colour(k, n))
        image(folder / f"results/depth{n:06d}.png", steps[n])
    (folder / "traj.txt").write_text("".join(" ".join(map(repr, one.ravel().tolist())) + "\n" for one in c2w))
    _cam_params(folder, k, 6553.5)
    return Written(c2w, steps, 6553.5, k, k, hz=20.0)


def _cam_params(folder, k, scale):
    camera = dict(zip(("w", "h", "fx", "fy", "cx", "cy"), k, strict=True))
    (folder / "cam_params.json").write_text(json.dumps({"camera": {**camera, "scale": scale}}))


def tum(folder):
    k = (64, 48, 58.0, 57.0, 31.25, 23.75)
    c2w = poses(seed=8)
    steps = _steps(k, c2w, 5000.0)
    lists = {"rgb": [], "depth": [], "groundtruth": []}
    for n, stamp_ns in enumerate(_stamps_ns()):
        for kind, late_ns, pixels in (("rgb", 0, colour(k, n)), ("depth", 5_000_000, steps[n])):
            at = f"{(stamp_ns + late_ns) // 10**9}.{(stamp_ns + late_ns) % 10**9 // 1000:06d}"
            image(folder / f"{kind}/{at}.png", pixels)
            lists[kind].append(f"{at} {kind}/{at}.png")
        at = f"{stamp_ns // 10**9}.{stamp_ns % 10**9 // 100_000:04d}"
        lists["groundtruth"].append(" ".join([at, *map(repr, [*c2w[n, :3, 3].tolist(), *_quaternion(c2w[n], "xyzw")])]))
    for name, rows in lists.items():
        (folder / f"{name}.txt").write_text("# a\n# b\n# c\n" + "".join(row + "\n" for row in rows))
    _cam_params(folder, k, 5000.0)
    return Written(c2w, steps, 5000.0, k, k)


SENSOR = """sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: {pose}
rate_hz: 30
resolution: [{wide}, {high}]
camera_model: pinhole
intrinsics: {values}
distortion_model: radial-tangential
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
"""


def _sensor_yaml(k, body_from_sensor, extra=""):
    text = SENSOR.format(pose=body_from_sensor.ravel().tolist(), wide=k[0], high=k[1], values=list(k[2:]))
    return text + extra


def euroc(folder):
    """Poses are those of a body on which the camera sits."""
    k = (64, 48, 58.0, 57.0, 31.25, 23.75)
    c2w = poses(seed=9)
    body_from_camera = poses(1, seed=99)[0]
    body = c2w @ np.linalg.inv(body_from_camera)
    steps = _steps(k, c2w, 2000.0)
    mav = folder / "mav0"
    lists = {"cam0": [], "depth0": [], "state_groundtruth_estimate0": []}
    for n, stamp_ns in enumerate(_stamps_ns()):
        for kind, pixels in (("cam0", colour(k, n)), ("depth0", steps[n])):
            image(mav / f"{kind}/data/{stamp_ns}.png", pixels)
            lists[kind].append(f"{stamp_ns},{stamp_ns}.png")
        row = [*body[n, :3, 3].tolist(), *_quaternion(body[n], "wxyz")]
        lists["state_groundtruth_estimate0"].append(",".join([str(stamp_ns), *map(repr, row)]))
    for name, rows in lists.items():
        (mav / name).mkdir(exist_ok=True)
        (mav / name / "data.csv").write_text("#timestamp [ns],others\n" + "".join(row + "\n" for row in rows))
    (mav / "cam0/sensor.yaml").write_text(_sensor_yaml(k, body_from_camera))
    (mav / "depth0/sensor.yaml").write_text(_sensor_yaml(k, body_from_camera, "depth_scale_per_m: 2000.0\n"))
    return Written(c2w, steps, 2000.0, k, k)


def tum_vi(folder):
    """EuRoC's files with the truth where TUM-VI's export has it."""
    written = euroc(folder)
    (folder / "mav0/state_groundtruth_estimate0").rename(folder / "mav0/mocap0")
    return written


def vslamlab(folder):
    k = (64, 48, 58.0, 57.0, 31.25, 23.75)
    c2w = poses(seed=10)
    steps = _steps(k, c2w, 2000.0)
    listed = ["ts_rgb_0 (ns),path_rgb_0,ts_depth_0 (ns),path_depth_0"]
    truth = ["ts (ns),tx (m),ty (m),tz (m),qx,qy,qz,qw"]
    for n, stamp_ns in enumerate(_stamps_ns()):
        image(folder / f"rgb_0/{stamp_ns}.png", colour(k, n))
        image(folder / f"depth_0/{stamp_ns}.png", steps[n])
        listed.append(f"{stamp_ns},rgb_0/{stamp_ns}.png,{stamp_ns},depth_0/{stamp_ns}.png")
        row = [*c2w[n, :3, 3].tolist(), *_quaternion(c2w[n], "xyzw")]
        truth.append(",".join([str(stamp_ns), *map(repr, row)]))
    (folder / "rgb.csv").write_text("\n".join(listed) + "\n")
    (folder / "groundtruth.csv").write_text("\n".join(truth) + "\n")
    told = f"focal_length: {list(k[2:4])}, principal_point: {list(k[4:])}, image_dimension: {list(k[:2])}"
    (folder / "calibration.yaml").write_text(
        "%YAML 1.2\n---\ncameras:\n  - {cam_name: rgb_0, cam_type: rgb+depth, depth_name: depth_0, "
        f"cam_model: pinhole, {told}, fps: 30.0, depth_factor: 2000.0, T_BS: {np.eye(4).ravel().tolist()}}}\n"
    )
    return Written(c2w, steps, 2000.0, k, k)


WRITTEN = {writer.__name__: writer for writer in (replica, tum, euroc, tum_vi, vslamlab)}
WRITERS = {
    writer.__name__: writer
    for writer in (
        *(seven_scenes, bundlefusion, scannet, icl_nuim, open3d, redwood, nerfstudio, colmap),
        *(tartanair, neural_rgbd, bop, record3d, polycam, openloris),
    )
}
