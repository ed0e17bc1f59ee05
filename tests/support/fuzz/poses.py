# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of poses: trajectories whose bytes and words are changed, and what systems write, changed by structure.

Poses of a trajectory are compared with those of plain readers, which are independent of the project's own, and of evo.
"""

import io
import json
import re
import struct
import warnings
import zipfile
from typing import get_args

import numpy as np
from scipy.spatial.transform import Rotation

from fuzz.mutation import NUMBERS, mutate_mixed, pick
from fuzz.peers import poses_by_evo
from fuzz.structure import OF_TABLES, PLAIN, as_cell, as_json, as_table, beside, changed, is_sound, note, whole
from noisy_world.core.errors import NoisyWorldError as Refused
from noisy_world.evaluate.cases import Outcome
from noisy_world.evaluate.system_runs import _states_problem, normalised
from noisy_world.evaluate.systems import Writes
from noisy_world.trajectories import formats
from noisy_world.trajectories.formats import TRAJECTORY_FORMATS as FORMATS
from noisy_world.trajectories.pose_files import PoseFile

COUNT = 6
STAMPS_S = [1000.0 + 0.1 * k for k in range(COUNT)]
TASK = "task.json"
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
WORDS = (
    "nan", "tracked", "lost", "frame000001.png", "index", "# ", "1000.1", "1000100000000", "transform_matrix", "pose",
)  # fmt: skip


def _poses():
    """Return (COUNT, 4, 4) poses of a camera that turns."""
    poses = np.tile(np.eye(4), (COUNT, 1, 1))
    for k in range(COUNT):
        cos, sin = np.cos(0.2 * k), np.sin(0.2 * k)
        poses[k, :2, :2] = [[cos, -sin], [sin, cos]]
        poses[k, :3, 3] = 0.1 * k, -0.2 * k, 1.0
    return poses


POSES = _poses()


def _rows(values):
    return [list(map(float, row)) for row in values]


def _quats_xyzw():
    return [[0.0, 0.0, float(np.sin(0.1 * k)), float(np.cos(0.1 * k))] for k in range(COUNT)]


def _stamped(scale=1):
    stamps = STAMPS_S if scale == 1 else [round(stamp * scale) for stamp in STAMPS_S]
    positions = _rows(POSES[:, :3, 3])
    return [[stamp, *at, *quat] for stamp, at, quat in zip(stamps, positions, _quats_xyzw(), strict=True)]


# --- a file of each reader: its tree, and how it is written ---


def _tum():
    return "poses.txt", _stamped(), as_table


def _tartanair():
    turned = np.diag([1.0, -1.0, -1.0]) @ POSES[:, :3, :3] @ np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0.0]])
    places, quats = POSES[:, :3, 3] * [1, -1, -1], Rotation.from_matrix(turned).as_quat()
    return "pose_left.txt", _rows(np.column_stack([places, quats])), as_table


def _euroc():
    rows = [[row[0], *row[1:4], row[7], *row[4:7]] for row in _stamped(10**9)]
    names = ["#timestamp", *(f"p_RS_R_{axis} [m]" for axis in "xyz"), *(f"q_RS_{axis} []" for axis in "wxyz")]
    return "poses.csv", [names, *rows], lambda tree: as_table(tree, ",")


def _kitti():
    return "poses.txt", _rows(POSES[:, :3].reshape(-1, 12)), as_table


def _replica():
    return "poses.txt", _rows(POSES.reshape(-1, 16)), as_table


def _matrices():
    return "poses.txt", _rows(POSES.reshape(-1, 4)), as_table


def _log():
    return "poses.log", [row for k in range(COUNT) for row in ([k, k, k + 1], *_rows(POSES[k]))], as_table


def _transforms():
    frames = [{"file_path": f"{k}.png", "transform_matrix": _rows(POSES[k] @ OPENGL)} for k in range(COUNT)]
    return "transforms.json", {"fl_x": 5.0, "w": 8, "h": 6, "camera_model": "OPENCV", "frames": frames}, as_json


def _colmap():
    lines = [["#", "Image list"]]
    for k, (x, y, z, w) in enumerate(_quats_xyzw()):
        at = -POSES[k, :3, :3].T @ POSES[k, :3, 3]
        lines += [[k + 1, w, -x, -y, -z, *map(float, at), 1, f"frame{k:06d}.png"], []]
    return "images.txt", lines, as_table


def _open3d():
    cameras = [{"class_name": "C", "extrinsic": np.linalg.inv(POSES[k]).T.ravel().tolist()} for k in range(COUNT)]
    return "trajectory.json", {"class_name": "PinholeCameraTrajectory", "parameters": cameras}, as_json


def _pose_graph():
    nodes = [{"class_name": "PoseGraphNode", "pose": POSES[k].T.ravel().tolist()} for k in range(COUNT)]
    return "graph.json", {"class_name": "PoseGraph", "edges": [], "nodes": nodes}, as_json


def _kitti360(rows=3):
    return "poses.txt", [[k, *row] for k, row in enumerate(_rows(POSES[:, :rows].reshape(COUNT, -1)))], as_table


def _cam0_to_world():
    return _kitti360(rows=4)


def _openvins():
    names = ["#", "timestamp(s)", "tx", "ty", "tz", "qx", "qy", "qz", "qw"]
    names += ["Pr11", "Pr12", "Pr13", "Pr22", "Pr23", "Pr33"]
    return "estimate.txt", [names, *([*row, *[1e-4] * 6] for row in _stamped())], as_table


def _rostopic():
    fields = [f"field.pose.position.{axis}" for axis in "xyz"]
    fields += [f"field.pose.orientation.{axis}" for axis in "xyzw"]
    names = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id", *fields]
    rows = [[row[0], k, row[0], "map", *row[1:]] for k, row in enumerate(_stamped(10**9))]
    return "pose.csv", [names, *rows], lambda tree: as_table(tree, ",")


def _vins():
    rows = [[row[0], *row[1:4], row[7], *row[4:7], 0.1, 0.2, 0.3, ""] for row in _stamped(10**9)]
    return "vio.csv", rows, lambda tree: as_table(tree, ",")


def _semicolons():
    name, tree, _ = _euroc()
    return name, tree, lambda tree: as_table(tree, ";").replace(b"\n", b"\r\n")


def _vslamlab():
    names = ["ts (ns)", "tx (m)", "ty (m)", "tz (m)", "qx", "qy", "qz", "qw"]
    return "00000_KeyFrameTrajectory.csv", [names, *_stamped(10**9)], lambda tree: as_table(tree, ",")


def _array(name="poses.npy"):
    return name, _described(POSES), _npy


def _described(array):
    """Return an array as a tree: what its header says, and its numbers."""
    shape = list(array.shape)
    return {
        "version": [1, 0],
        "descr": array.dtype.str,
        "fortran_order": False,
        "shape": shape,
        "data": array.ravel().tolist(),
    }


def _npy(tree):
    """Return a tree as a .npy, whose header may disagree with its numbers."""
    if not isinstance(tree, dict):
        return as_cell(tree)
    head = {name: tree[name] for name in tree if name not in ("version", "data", "kept")}
    if isinstance(head.get("shape"), list):
        head["shape"] = tuple(head["shape"])
    try:
        text = repr(head).encode("utf-8", "surrogatepass")
    except ValueError:  # Python writes no integer of thousands of digits
        text = b"{}"
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    version = [whole(part, 0, 255) for part in _listed(tree.get("version"))[:2]]
    return b"\x93NUMPY" + bytes(version or [1]) + struct.pack("<H", len(text) % 65536) + text + _numbers(tree)


def _numbers(tree):
    kind = tree.get("descr")
    try:
        return np.array(tree.get("data"), dtype=kind if isinstance(kind, str) else "<f8").tobytes()
    except (TypeError, ValueError, OverflowError, MemoryError, SyntaxError):
        return b"\0" * 96


def _listed(value):
    return value if isinstance(value, list) else [value]


def _npz(tree):
    """Return a tree of arrays as a .npz."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a name may stand there twice
        for name, array in tree.items() if isinstance(tree, dict) else [("poses", tree)]:
            archive.writestr(f"{name}.npy".replace("\0", "0")[:200].encode("utf-8", "replace").decode(), _npy(array))
    return file.getvalue()


def _array_of_some():
    held = {"poses": _described(POSES[::2]), "stamps_s": _described(np.array(STAMPS_S[::2]))}
    return "poses.npz", held, _npz


def _array_by_number():
    return "poses.npz", {"c2w": _described(POSES[::2]), "frames": _described(np.arange(0, COUNT, 2))}, _npz


def _splatam():
    w2c = np.linalg.inv(POSES)
    quats = np.array([[w, -x, -y, -z] for x, y, z, w in _quats_xyzw()], "<f4")
    held = {"cam_unnorm_rots": quats.T[None], "cam_trans": w2c[:, :3, 3].astype("<f4").T[None]}
    return "params.npz", {name: _described(np.ascontiguousarray(array)) for name, array in held.items()}, _npz


WRITERS = {
    "tum": (_tum, _openvins, _rostopic),
    "euroc": (_euroc, _vins, _semicolons),
    "kitti360": (_kitti360, _cam0_to_world),
    "open3d": (_open3d, _pose_graph),
    "tartanair": (_tartanair,),
    "kitti": (_kitti,),
    "replica": (_replica,),
    "matrices": (_matrices,),
    "log": (_log,),
    "transforms": (_transforms,),
    "array": (_array, _array_of_some, _array_by_number),
    "colmap": (_colmap,),
    "vslamlab": (_vslamlab,),
    "splatam": (_splatam,),
}
assert set(WRITERS) == set(FORMATS), "a reader's format is written, too"


def _states():
    return [["index", "stamp_s", "state"], *([k, STAMPS_S[k], "tracked"] for k in range(COUNT))]


def write_estimate(folder, rng):
    """Write an estimate, or a list of states; task.json says which reader is asked."""
    beside(folder)
    out = folder / "out"
    out.mkdir()
    if rng.integers(12) == 0:
        tree, told = changed(_states(), rng, raws=OF_TABLES, words=WORDS)
        (out / "frames.csv").write_bytes(as_table(tree, ","))
        (folder / TASK).write_text(json.dumps({"format": None}))
        note(folder, told)
        return
    format_ = pick(rng, tuple(WRITERS))
    name, tree, render = pick(rng, WRITERS[format_])()
    binary = render not in (as_table, as_json) and name.rpartition(".")[2] in ("npy", "npz")
    tree, told = changed(tree, rng, raws=() if binary else OF_TABLES, words=WORDS)
    try:
        data = render(tree)
    except (TypeError, ValueError, OverflowError, struct.error):  # a value that the format has no place for
        data = as_cell(pick(rng, [value for value in PLAIN if not isinstance(value, dict)]))
        told.append("nothing of its format")
    (out / name).write_bytes(data)
    auto = bool(rng.integers(2))
    (folder / TASK).write_text(json.dumps({"format": "auto" if auto else format_, "file": name}))
    note(folder, told)


def read_estimate(folder):
    """Read what the system wrote, as its run does: whatever it is, that becomes an outcome with a line on it."""
    task = json.loads((folder / TASK).read_text())
    out = folder / "out"
    if task["format"] is None:
        problem = _states_problem(out / "frames.csv", COUNT)
        if problem:
            raise Refused(f"{out}: {problem}")
        return None
    colour = [out / f"frame{k:06d}.png" for k in range(COUNT)]
    found = normalised(out, Writes(task["file"], format=task["format"]), STAMPS_S, colour=colour)
    if found.outcome is not Outcome.FINISHED:
        raise Refused(f"{out}: {found.detail}")
    if len(found.estimate) and not set(found.estimate.stamps_s.tolist()) & set(STAMPS_S):
        raise Refused(f"{out}: {found.detail}")  # whose score says that no pose has the stamp of a frame
    return found.estimate


def estimate_differs(folder, estimate):
    """Say what of an estimate is none, and how that of a sound file differs from the poses it was written from."""
    if estimate is None:
        return ""
    if not (np.isfinite(estimate.c2w).all() and set(estimate.stamps_s.tolist()) <= set(STAMPS_S)):
        return "an estimate of frames that there are not, or no finite one"
    if (np.diff(estimate.stamps_s) <= 0).any():
        return f"stamps do not increase: {estimate.stamps_s}"
    rotations = estimate.c2w[:, :3, :3]
    if len(rotations) and np.abs(rotations @ np.swapaxes(rotations, 1, 2) - np.eye(3)).max() > 1e-6:
        return "a pose is not rigid"
    if is_sound(folder):
        rows = [STAMPS_S.index(stamp) for stamp in estimate.stamps_s.tolist()]
        apart = np.abs(estimate.c2w[:, :3, 3] - POSES[rows, :3, 3]).max(initial=0.0)
        turned = np.abs(rotations - POSES[rows, :3, :3]).max(initial=0.0)
        if apart > 1e-5 or turned > 1e-5 or len(rows) < 3:
            return f"other poses: {apart:.2g} m apart, rotations by {turned:.2g}, {len(rows)} of them"
    return ""


# --- trajectories ---

TEXT_WORDS = (
    *NUMBERS, "#", "# timestamp tx ty tz qx qy qz qw\n", "timestamp", "#timestamp [ns]", "q_w", "q_x", ",", ", ", ";",
    " ", "\t", "\n", "\r", "\r\n", "\n\n", "\0", "\ufeff", "\u2028", "\x0c", "1403636579763555584", "0 0 0 1",
    "0 0 0", "1e", "e", "-", "{", "}", "[", "]", '"', ":", "frames", "transform_matrix", "None", "null", "NaN",
)  # fmt: skip
KNOWN = get_args(formats.TrajectoryFormat)
KINDS = {
    "traj.txt": (_tum, _kitti, _replica, _matrices),
    "data.csv": (_euroc,),
    "traj.log": (_log,),
    "transforms.json": (_transforms,),
}
HEADS = ("", "", "# ground truth trajectory\n# file: 'a.bag'\n# timestamp tx ty tz qx qy qz qw\n")


def write(folder, rng):
    """Write a file of poses, or of some of them, with changes of its words or bytes."""
    name = pick(rng, ("traj.txt",) * 4 + ("data.csv",) * 2 + ("traj.log", "transforms.json"))
    writer = pick(rng, KINDS[name])
    _, tree, render = writer()
    if writer is _euroc and rng.integers(2):
        tree = [[*row, *["v" if row is tree[0] else 0.1] * 9] for row in tree]
    step = {_matrices: 4, _log: 5}.get(writer, 1)
    if isinstance(tree, list) and rng.integers(2):
        tree = tree[: (writer is _euroc) + step * int(rng.integers(1, COUNT))]
    text = render(tree).decode()
    if name == "traj.txt":
        text = pick(rng, HEADS) * (writer is _tum) + text
        for old, others in ((" ", (" ", " ", " ", "  ", "\t", ",", ", ")), ("\n", ("\n", "\n", "\r\n"))):
            text = text.replace(old, pick(rng, others))
    (folder / name).write_bytes(mutate_mixed(text, rng, TEXT_WORDS))


def _file(folder):
    return next(folder / name for name in KINDS if (folder / name).exists())


def read(folder):
    """Read the file; return what it was read as, with its poses."""
    path = _file(folder)
    trajectory = formats.read_trajectory(path)
    assert len(trajectory)
    assert np.isfinite(trajectory.c2w).all()
    assert np.isfinite(trajectory.stamps_s).all()
    file = PoseFile(path)
    known = [item.name for item in formats.TRAJECTORY_FORMATS.values() if item.recognises(file)]
    return known[0] if known else "", trajectory


def differs(folder, meaning):
    """Return how the poses differ from those of a plain reader and of evo, or "".

    A reader that refuses the file says nothing: ours also takes commas, tabs and comments behind numbers.
    """
    format_, trajectory = meaning
    path = _file(folder)
    if "euroc" in KNOWN and format_ != "euroc" and path.name == "data.csv" and _is_euroc(path):
        return f"a data.csv of EuRoC is read as {format_}"
    found = {"a plain reader": read_plainly(path, format_)}
    # evo takes the columns in EuRoC's order, whatever the header names.
    if format_ != "euroc" or named_order(path) == list("wxyz"):
        found["evo"] = poses_by_evo(path, format_)
    for name, other in found.items():
        if other is not None and (told := _difference(trajectory, *other)):
            return f"{told} in {name}, read as {format_}"
    return ""


def _difference(ours, stamps_s, c2w):
    """Compare with stamps (N,), None where the format has none, and poses (N, 4, 4), the rotations as they stand."""
    if stamps_s is not None and len(stamps_s) == len(c2w):  # of poses with one stamp ours keeps the first
        first = np.flatnonzero(np.diff(stamps_s, prepend=-np.inf) != 0.0)
        stamps_s, c2w = np.asarray(stamps_s)[first], c2w[first]
    if len(ours) != len(c2w):
        return f"{len(ours)} poses, but {len(c2w)}"
    if stamps_s is not None and not np.allclose(ours.stamps_s, stamps_s, rtol=1e-15, atol=1e-9):
        return f"other stamps: {ours.stamps_s[:3]}, but {stamps_s[:3]}"
    if not np.allclose(ours.c2w[:, :3, 3], c2w[:, :3, 3], rtol=1e-12, atol=1e-12):
        return f"other positions: {ours.c2w[0, :3, 3]}, but {c2w[0, :3, 3]}"
    if not np.allclose(ours.c2w[:, :3, :3], c2w[:, :3, :3], atol=1e-2):
        return f"other rotations: {ours.c2w[0, :3, :3].tolist()}, but {c2w[0, :3, :3].tolist()}"
    return ""


# --- plain readers, with loadtxt and json ---


def _rotations(quat_wxyz):
    """Return (N, 3, 3) of unit quaternions (N, 4), written out from Hamilton's product."""
    w, x, y, z = quat_wxyz.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def _from_quats(stamps_s, at, quat_wxyz):
    poses = np.tile(np.eye(4), (len(at), 1, 1))
    poses[:, :3, :3] = _rotations(quat_wxyz / np.linalg.norm(quat_wxyz, axis=1, keepdims=True))
    poses[:, :3, 3] = at
    return stamps_s, poses


def _table(path, columns, separator=None):
    table = np.loadtxt(path, ndmin=2, delimiter=separator, encoding="utf-8")
    if table.shape[1] not in columns:
        raise ValueError("another number of columns")
    return table


def _read_tum(path):
    table = _table(path, (8,))
    return _from_quats(table[:, 0], table[:, 1:4], np.roll(table[:, 4:], 1, axis=1))


def _read_kitti(path):
    table = _table(path, (12,)).reshape(-1, 3, 4)
    return None, np.concatenate([table, np.tile([[[0.0, 0.0, 0.0, 1.0]]], (len(table), 1, 1))], axis=1)


def _read_replica(path):
    return None, _table(path, (16,)).reshape(-1, 4, 4)


def named_order(path):
    """Return the order of a quaternion's numbers that the header of EuRoC's columns names; w, x, y, z without one."""
    first = path.read_text(encoding="utf-8", errors="replace").splitlines()[0]
    named = re.findall(r"q_RS_([wxyz]) \[\]", first)
    return named if sorted(named) == list("wxyz") else list("wxyz")


def _read_euroc(path):
    table = _table(path, (8, 17), ",")
    order = [4 + named_order(path).index(name) for name in "wxyz"]
    return _from_quats(table[:, 0] / 1e9, table[:, 1:4], table[:, order])


def _finite(poses):
    """Leave out the poses where tracking was lost."""
    return poses[np.isfinite(poses).all(axis=(1, 2))]


def _read_matrices(path):
    return None, _finite(_table(path, (4,)).reshape(-1, 4, 4))


def _read_log(path):
    numbers = [float(word) for word in path.read_text().split()]
    return None, _finite(np.array(numbers).reshape(-1, 19)[:, 3:].reshape(-1, 4, 4))


def _read_transforms(path):
    document = json.loads(path.read_text())
    poses = np.array([item["transform_matrix"] for item in document["frames"]], dtype=np.float64)
    return None, _finite(poses @ np.diag([1.0, -1.0, -1.0, 1.0]))  # OpenGL's camera axes to OpenCV's


PLAIN_READERS = {
    "tum": _read_tum, "kitti": _read_kitti, "replica": _read_replica, "euroc": _read_euroc, "matrices": _read_matrices,
    "log": _read_log, "transforms": _read_transforms,
}  # fmt: skip


def _is_euroc(path):
    """Tell whether a file is read as EuRoC's: whole nanoseconds before 7 or 16 numbers, separated by commas."""
    try:
        _read_euroc(path)
    except ValueError:
        return False
    rows = [
        line for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip() and line.strip()[0] != "#"
    ]
    return all(row.partition(",")[0].strip().isdecimal() for row in rows)


def read_plainly(path, format_):
    """Return stamps, or None, and poses (N, 4, 4); None where the format is unknown or this reader refuses the file."""
    if format_ not in PLAIN_READERS:
        return None
    try:
        return PLAIN_READERS[format_](path)
    except (ValueError, KeyError, TypeError, OverflowError):
        return None
