# SPDX-License-Identifier: GPL-3.0-or-later
"""Stands in for noisy_world.render.mesh_session where a test is about files: frames from arithmetic, at once."""

from types import SimpleNamespace

import numpy as np

from noisy_world.render.source import ColourAndDepth


class Frame(SimpleNamespace, ColourAndDepth):
    def file_as(self, modality, format_):
        return None


def renderer_versions(engine, device="cpu"):
    return {"blender": "none"}


def blender_version():
    return {"blender": "none"}


class Session:
    notes = ()
    rendered: list[int] = []
    empty: set[int] = set()  # frames that see nothing

    def __init__(self, mesh, name, paths, intrinsics, options):
        self.origin_m = np.zeros(3)
        self._options = options
        self._shape = (intrinsics.height_px, intrinsics.width_px)

    def serves(self, paths, options):
        return True

    def frame(self, request):
        frame = request.index
        Session.rendered.append(frame)
        ramp = np.linspace(0, 1, self._shape[0] * self._shape[1], dtype=np.float32).reshape(self._shape)
        rgb = np.stack([ramp, 1 - ramp, np.full_like(ramp, frame / 255)], axis=-1)
        depth_m = 1 + ramp + np.float32(frame)
        if frame in Session.empty:
            rgb, depth_m = np.zeros_like(rgb), np.zeros_like(depth_m)
        return Frame(rgb=rgb if self._options.rgb else None, depth_m=depth_m if self._options.depth else None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass
