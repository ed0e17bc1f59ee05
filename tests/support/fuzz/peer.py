# SPDX-License-Identifier: GPL-3.0-or-later
"""Independent readers in another Python: evo for poses, plyfile for meshes, Pillow for images.

Run by that Python, this file is the server: a line of JSON in, a line of JSON out.
"""

import importlib
import json
import subprocess
import sys
from pathlib import Path


class Peer:
    """Asks the readers of another Python, which has evo, plyfile and Pillow."""

    def __init__(self, python):
        self._process = subprocess.Popen(
            [python, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        )
        assert self._ask({"kind": "hello"}) == "hello", f"{python} has not what is needed: evo, plyfile, pillow"

    def _ask(self, order):
        self._process.stdin.write(json.dumps(order).encode() + b"\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        return json.loads(answer) if answer else None

    def poses(self, path, format_):
        """Return stamps (N,), or None, and poses (N, 4, 4); None where evo refuses the file or knows no such format."""
        import numpy as np

        found = self._ask({"kind": "poses", "path": str(path), "format": format_})
        if found is None:
            return None
        stamps_s, c2w = found
        return None if stamps_s is None else np.array(stamps_s), np.array(c2w)

    def mesh(self, path):
        """Return vertices (V, 3) and faces, lists of indices; None where plyfile refuses the file."""
        return self._ask({"kind": "mesh", "path": str(path)})

    def image(self, path):
        """Return the pixels as an array, a text of what is wrong, or None for a kind that Pillow does not know."""
        import numpy as np

        found = self._ask({"kind": "image", "path": str(path)})
        return np.array(found) if isinstance(found, list) else found


# --- the server ---


def _poses(path, format_):
    from evo.tools import file_interface

    readers = {
        "tum": file_interface.read_tum_trajectory_file,
        "kitti": file_interface.read_kitti_poses_file,
        "euroc": file_interface.read_euroc_csv_trajectory,
    }
    if format_ not in readers:
        return None
    found = readers[format_](path)
    stamps = getattr(found, "timestamps", None)
    return None if stamps is None else stamps.tolist(), [pose.tolist() for pose in found.poses_se3]


def _mesh(path):
    import plyfile

    data = plyfile.PlyData.read(path)
    vertex, face = data["vertex"], data["face"]
    points = [[float(value) for value in row] for row in zip(vertex["x"], vertex["y"], vertex["z"], strict=True)]
    names = [item.name for item in face.properties]
    name = "vertex_indices" if "vertex_indices" in names else "vertex_index"
    return points, [[int(index) for index in row] for row in face[name]]


def _image(path):
    import numpy as np
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            if image.mode not in ("RGB", "L", "I;16"):
                return None
            return np.asarray(image).tolist()
    except UnidentifiedImageError:
        return None
    except (OSError, SyntaxError, ValueError) as error:
        return str(error)


def _serve():
    for name in ("evo.tools.file_interface", "PIL.Image", "plyfile"):
        importlib.import_module(name)
    for line in sys.stdin:
        order = json.loads(line)
        kind = order["kind"]
        try:
            if kind == "poses":
                answer = _poses(order["path"], order["format"])
            elif kind == "mesh":
                answer = _mesh(order["path"])
            else:
                answer = "hello" if kind == "hello" else _image(order["path"])
        except Exception:  # noqa: BLE001 - it refuses the file in its own way
            answer = None
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    sys.path.remove(str(Path(__file__).parent))  # where `trajectories` and others are ours
    _serve()
