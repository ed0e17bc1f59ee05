# SPDX-License-Identifier: GPL-3.0-or-later
"""Independent readers, asked where their packages are: evo for poses, plyfile for meshes, Pillow for images."""

import functools
import importlib

import numpy as np


@functools.cache
def _module(name):
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def poses_by_evo(path, format_):
    """Return stamps (N,) and poses (N, 4, 4); None where evo is not here, refuses the file or knows no such format."""
    names = {"tum": "read_tum_trajectory_file", "euroc": "read_euroc_csv_trajectory"}
    files = _module("evo.tools.file_interface")
    if files is None or format_ not in names:
        return None
    try:
        found = getattr(files, names[format_])(path)
    except Exception:  # noqa: BLE001 - it refuses the file in its own way
        return None
    return np.array(found.timestamps), np.array(found.poses_se3)


def plyfile_data(path):
    """Return what plyfile reads of a PLY; None where it is not here or refuses the file."""
    plyfile = _module("plyfile")
    try:
        return None if plyfile is None else plyfile.PlyData.read(str(path), mmap=False)
    except Exception:  # noqa: BLE001 - it refuses the file in its own way
        return None


def image_by_pillow(path):
    """Return the pixels as an array, a text of what is wrong, or None for a kind that Pillow does not know."""
    pillow = _module("PIL.Image")
    if pillow is None:
        return None
    try:
        with pillow.open(path) as image:
            return np.asarray(image).astype(np.float64) if image.mode in ("RGB", "L", "I;16") else None
    except _module("PIL").UnidentifiedImageError:
        return None
    except (OSError, SyntaxError, ValueError) as error:
        return str(error)
