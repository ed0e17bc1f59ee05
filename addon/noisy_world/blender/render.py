# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames out of Blender as float arrays: colour and planar depth, each only where it is asked for."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import StorageError

AVERAGING_FILTER_PX = 1.5
CENTRE_FILTER_PX = 0.01
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - a folder of our own is made in it


@dataclass(frozen=True)
class RenderedFrame:
    """One rendered frame.

    rgb: (H, W, 3) float32, display-encoded (sRGB), nominally [0, 1]; None where it was not asked for. Void is black.
    depth_m: (H, W) float32, planar depth of the pixel's centre in metres, 0 = void; None where it was not asked for.
    """

    rgb: NDArray[np.float32] | None
    depth_m: NDArray[np.float32] | None


def configure_cycles(scene: bpy.types.Scene, *, seed: int, threads: int) -> None:
    """Set Cycles up for unlit colours: no light, no bounce, no denoiser, no tile.

    threads 0: as many as the machine has.
    """
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.seed = seed
    cycles.use_animated_seed = True
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.use_auto_tile = False
    cycles.use_light_tree = False
    cycles.max_bounces = 0
    cycles.transparent_max_bounces = 0
    cycles.sampling_pattern = "TABULATED_SOBOL"
    cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    cycles.film_exposure = 1.0
    render = scene.render
    render.use_persistent_data = True
    render.use_compositing = False
    render.use_sequencer = False
    render.use_motion_blur = False
    render.use_simplify = False
    render.film_transparent = False
    render.threads_mode = "FIXED" if threads else "AUTO"
    if threads:
        render.threads = threads
    # The scene has no world, which is black: void shows nothing.
    scene.world = None


class FrameRenderer:
    """Renders frames of a keyed camera into arrays, through a scratch file in memory.

    A render result cannot be read from Python in background mode; an uncompressed float EXR can, in 7 ms.
    """

    def __init__(
        self, scene: bpy.types.Scene, *, width_px: int, height_px: int, samples: int, encoded_colours: bool
    ) -> None:
        """Prepare to render `samples` rays a pixel; encoded_colours: the scene emits display-encoded values."""
        self._scene = scene
        self._crop = (slice(height_px), slice(width_px))
        self._samples = samples
        self._encoded_colours = encoded_colours
        in_memory = SHARED_MEMORY.is_dir() and os.access(SHARED_MEMORY, os.W_OK)
        self._scratch = tempfile.TemporaryDirectory(prefix="noisy-world-", dir=SHARED_MEMORY if in_memory else None)
        self._path = Path(self._scratch.name) / "frame.exr"
        render = scene.render
        render.filepath = str(self._path)
        render.use_file_extension = False
        render.use_overwrite = True
        settings = render.image_settings
        settings.media_type = "MULTI_LAYER_IMAGE"
        settings.file_format = "OPEN_EXR_MULTILAYER"
        settings.color_depth = "32"
        settings.exr_codec = "NONE"
        settings.use_exr_interleave = True

    def close(self) -> None:
        """Remove the scratch file."""
        self._scratch.cleanup()

    def __enter__(self) -> "FrameRenderer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def render(self, camera: bpy.types.Object, frame: int, *, rgb: bool, depth: bool) -> RenderedFrame:
        """Render one frame of the timeline through the camera.

        Raises StorageError where the scratch file could not be written, a full disk for instance.
        """
        self._scene.camera = camera
        self._scene.frame_set(frame)
        if self._samples == 1 or not (rgb and depth):
            return self._render_passes(rgb=rgb, depth=depth, samples=self._samples if rgb else 1)
        colour = self._render_passes(rgb=True, depth=False, samples=self._samples)
        return RenderedFrame(colour.rgb, self._render_passes(rgb=False, depth=True, samples=1).depth_m)

    def _render_passes(self, *, rgb: bool, depth: bool, samples: int) -> RenderedFrame:
        scene = self._scene
        layer = scene.view_layers[0]
        layer.use_pass_combined = rgb
        layer.use_pass_z = depth
        scene.cycles.samples = samples
        # Z is that of a pixel's first sample, which goes through the middle of the filter. Cycles looks that up in a
        # table whose middle is 4e-4 filter widths off: with a wide filter, depth along a wall is wrong by up to 1e-4.
        scene.cycles.filter_width = AVERAGING_FILTER_PX if samples > 1 else CENTRE_FILTER_PX
        self._path.unlink(missing_ok=True)
        problem = ""
        try:
            with muted_stdout():
                bpy.ops.render.render(write_still=True)
        except RuntimeError as error:  # how Blender reports that it could not write
            problem = str(error).strip().splitlines()[-1]
        if problem or not self._path.exists():
            raise StorageError(f"{self._path}: Blender could not write its scratch file: {problem or 'no file came'}")
        return self._read(rgb=rgb, depth=depth)

    def _read(self, *, rgb: bool, depth: bool) -> RenderedFrame:
        import OpenEXR

        with OpenEXR.File(str(self._path), separate_channels=True) as file:
            channels = {name.split(".", 1)[-1]: item.pixels[self._crop] for name, item in file.channels().items()}
        colours = None
        if rgb:
            colours = np.stack([channels[f"Combined.{name}"] for name in "RGB"], axis=-1)
            if not self._encoded_colours:
                colours = srgb_from_linear(colours)
        depth_m = None
        if depth:
            depth_m = channels["Depth.Z"]
            # Cycles gives a pixel that hits nothing 1e10, whatever the far clipping.
            depth_m = np.where(depth_m < self._scene.camera.data.clip_end, depth_m, np.float32(0))
        return RenderedFrame(colours, depth_m)


def srgb_from_linear(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Encode linear light (any shape, float32) for a display (IEC 61966-2-1)."""
    power = np.maximum(linear, np.float32(0.0031308)) ** np.float32(1 / 2.4)
    return np.where(
        linear <= np.float32(0.0031308), linear * np.float32(12.92), np.float32(1.055) * power - np.float32(0.055)
    )


@contextlib.contextmanager
def muted_stdout() -> Iterator[None]:
    """Keep the lines that Blender prints for each frame off the program's output.

    They come from C, so it is the file descriptor that is turned away; whoever prints meanwhile uses a copy of it.
    """
    saved = os.dup(1)
    null = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null, 1)
        yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
        os.close(null)
