# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses how rays are cast: in packets where numba is installed and it pays, else one by one, with equal values."""

import numpy as np
from numpy.typing import NDArray

from ..core.extras import install_command
from ..core.home import private_cache_folder
from ..core.planning.source import RenderOptions
from ..core.scenes.mesh import Mesh
from .casting import Caster, CastMesh
from .embree import check_embree
from .embree_library import LibraryError
from .ray_by_ray import RayByRay

# Measured: importing numba and its compiled code takes .4 s; packets spare .1 s a million rays, and in building the
# tree .4 s a million triangles.
PAYS_FROM_RAYS = 4_000_000
RAYS_FOR_A_TRIANGLE = 4


def caster_of(
    mesh: Mesh, vertices_m: NDArray[np.float32], corners: NDArray[np.int32], options: RenderOptions, rays: int
) -> tuple[Caster, tuple[str, ...]]:
    """Return the mesh ready for rays, and what a user should know about how they are cast.

    vertices_m: (V, 3), as they are seen. corners: (T, 3), of its triangles. rays: how many there will be at most.

    Raises MissingDependencyError where embreex cannot be imported.
    """
    check_embree()
    notes: tuple[str, ...] = ()
    cast = CastMesh(mesh, vertices_m, corners, options.near_m, options.far_m, options.rgb)
    if rays + RAYS_FOR_A_TRIANGLE * len(corners) >= PAYS_FROM_RAYS:
        folder = private_cache_folder()
        try:
            from .packets import Packets

            packets = Packets(cast, folder)
        except (ImportError, LibraryError) as error:
            remedy = f"; run: {install_command('embree')}" if isinstance(error, ModuleNotFoundError) else ""
            notes = (f"rays are cast one by one, which takes twice as long: {error}{remedy}",)
        else:
            kept = "not kept: there is no folder for it that is yours alone" if folder is None else f"kept in {folder}"
            took = f"compiling the code that casts rays took {packets.compiling_s:.1f} s; it is {kept}"
            return packets, (took,) if packets.compiling_s else ()
    return RayByRay(cast), notes
