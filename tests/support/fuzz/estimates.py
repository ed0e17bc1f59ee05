# SPDX-License-Identifier: GPL-3.0-or-later
"""What systems write: estimates in the format of every reader, changed by structure, and lists of frames' states."""

import io
import json
import struct
import warnings
import zipfile

import numpy as np
from fuzz.mutation import pick
from fuzz.structure import OF_NUMBERS, PLAIN, as_cell, as_json, as_table, changed, is_sound, note, raws, whole

from noisy_world.core.errors import NoisyWorldError as Refused
from noisy_world.evaluation.outcome import Outcome
from noisy_world.evaluation.systems.definition import Writes
from noisy_world.evaluation.systems.normalising import normalised
from noisy_world.evaluation.estimates import FORMATS
from noisy_world.evaluation.systems.running import _states_problem

COUNT = 6
STAMPS_S = [1000.0 + 0.1 * k for k in range(COUNT)]
TASK = "task.json"
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
WORDS = (
    "nan", "tracked", "lost", "frame000001.png", "index", "# ", "1000.1", "1000100000000", "transform_matrix", "pose",
)  # fmt: skip
RAWS = raws(*OF_NUMBERS, b"-inf", b"1_0", b"1e400", b"\x1a")


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
    "tum": (_tum,),
    "euroc": (_euroc,),
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


def write(folder, rng):
    """Write an estimate, or a list of states; task.json says which reader is asked."""
    (folder / "outside").mkdir()
    (folder / "outside/kept.txt").write_text("somebody's")
    out = folder / "out"
    out.mkdir()
    if rng.integers(12) == 0:
        tree, told = changed(_states(), rng, raws=RAWS, words=WORDS)
        (out / "frames.csv").write_bytes(as_table(tree, ","))
        (folder / TASK).write_text(json.dumps({"format": None}))
        note(folder, told)
        return
    format_ = pick(rng, tuple(WRITERS))
    name, tree, render = pick(rng, WRITERS[format_])()
    binary = render not in (as_table, as_json) and name.rpartition(".")[2] in ("npy", "npz")
    tree, told = changed(tree, rng, raws=() if binary else RAWS, words=WORDS)
    try:
        data = render(tree)
    except (TypeError, ValueError, OverflowError, struct.error):  # a value that the format has no place for
        data = as_cell(pick(rng, [value for value in PLAIN if not isinstance(value, dict)]))
        told.append("nothing of its format")
    (out / name).write_bytes(data)
    auto = format_ in ("tum", "euroc", "kitti", "replica", "matrices", "log", "transforms") and bool(rng.integers(2))
    (folder / TASK).write_text(json.dumps({"format": "auto" if auto else format_, "file": name}))
    note(folder, told)


def read(folder):
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


def differs(folder, estimate, peer=None):
    """Say what of an estimate is none, and how that of a sound file differs from the poses it was written from."""
    del peer
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
