# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of the street: rendered, written and read, scene-linear colour with depth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from noisy_world.blender.depth_scene import set_frame, without_void
from noisy_world.blender.render import RenderFile
from noisy_world.blender.typed import cycles as cycles_of

from .scene import CLIP_M, Street

BRIGHTEST = 60_000.0  # that a half float holds


@dataclass(frozen=True)
class LitFrame:
    """A frame. rgb: (H, W, 3) float32, scene-linear light, Rec. 709; depth_m: (H, W) float32, planar, 0 = void."""

    rgb: NDArray[np.float32]
    depth_m: NDArray[np.float32]


class StreetCamera:
    """Renders the street at frames of its path, without compositing."""

    def __init__(self, street: Street, samples: int) -> None:
        """Take over the street's scene. samples: a pixel, in Cycles, before its denoiser."""
        self._street = street
        scene = street.scene
        scene.render.use_compositing = False
        cycles_of(scene).samples = samples
        self._file = RenderFile(scene, (scene.render.resolution_x, scene.render.resolution_y))

    def frame(self, number: int) -> LitFrame:
        """Render a frame of the path."""
        scene = self._street.scene
        set_frame(scene, number)
        channels = self._file.render(scene.view_layers[0].name)
        rgb = np.stack([channels[f"Combined.{name}"] for name in "RGB"], axis=-1)
        return LitFrame(np.clip(rgb, 0.0, BRIGHTEST), without_void(channels["Depth.Z"], CLIP_M[1]))

    def close(self) -> None:
        """Remove the scratch file."""
        self._file.close()

    def __enter__(self) -> "StreetCamera":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def write_frame(path: Path, frame: LitFrame, *, exact_depth: bool = True) -> None:
    """Write a frame as an EXR: RGB as half floats, depth as float32 in the channel Z, or as half floats too."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    depth_m = frame.depth_m if exact_depth else frame.depth_m.astype(np.float16)
    channels = {"RGB": np.ascontiguousarray(frame.rgb.astype(np.float16)), "Z": np.ascontiguousarray(depth_m)}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def read_frame(path: Path) -> LitFrame:
    """Read what `write_frame` wrote."""
    with OpenEXR.File(str(path)) as file:
        channels = file.channels()
        return LitFrame(channels["RGB"].pixels.astype(np.float32), channels["Z"].pixels.astype(np.float32))
