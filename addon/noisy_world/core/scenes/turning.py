# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns meshes whose files have another axis up, as Blender's importers do, and back."""

from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from .mesh import Mesh

Up: TypeAlias = Literal["y", "z"]
"""The axis of a mesh's file that points up."""


def turned(mesh: Mesh, stands: Up, asked: Up) -> Mesh:
    """Return a mesh as it stands where another axis of its file is taken for up; Z is up then, whichever it was.

    stands: the axis that was taken for up. Y up becomes (x, -z, y).
    """
    if stands == asked:
        return mesh
    x, y, z = mesh.vertices_m.T
    return replace(mesh, vertices_m=np.stack([x, -z, y] if asked == "y" else [x, z, -y], axis=1) + 0.0)
