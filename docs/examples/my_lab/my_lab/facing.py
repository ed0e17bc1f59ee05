# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the surface faces the camera: the cosine of the angle between its normal and the optical axis."""

import numpy as np

from noisy_world.extend import SurfaceChannel


class Facing(SurfaceChannel):
    """1 where the surface faces the camera, 0 where it is seen from the side."""

    name = "facing"
    label = "Facing"
    meaning = "how far the surface faces the camera"
    spoken = "facing"
    dtype = "float32"
    components = 1
    unit = "1"
    convention = "uint16 = round(65535 * -n_z), n the unit normal in camera axes; 0 is void"
    needs = frozenset({"normals"})
    bytes_per_pixel = 0.3

    def of_mesh(self, mesh):
        return lambda surface: np.maximum(-surface.normals[..., 2], 0)

    def steps_of(self, pixels):
        return np.rint(65535 * pixels).astype(np.uint16)


CHANNEL = Facing()
