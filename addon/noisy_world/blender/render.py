# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames out of Blender as float arrays: colour and planar depth, each only where it is asked for."""

import contextlib
import os
import shutil
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
# Z is that of a pixel's first sample, which goes through the middle of the filter. Cycles looks the middle up in a
# table of 1024 entries that is symmetric about entry 511, not 511.5: half a step off, to the right and up. A step there
# is the integral of the Blackman-Harris filter, a0, over 511, of half its width, which is twice what is set. With the
# averaging filter that is 5e-4 px, and depth along a wall would be wrong by up to 1e-4 of itself.
FILTER_MIDDLE = 0.5 * 0.35875 / 511
EXR_BYTES_PER_PIXEL = 20  # five channels of float32
SCRATCH_PREFIX = "noisy-world-"
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


def filter_width_px(samples: int) -> float:
    """Return the width of the pixel filter: none for a single sample, which shows the pixel's centre."""
    return CENTRE_FILTER_PX if samples == 1 else AVERAGING_FILTER_PX


def filter_offset_px(samples: int) -> float:
    """Return how far right of and above a pixel's centre its first sample goes, in pixels; see FILTER_MIDDLE."""
    return FILTER_MIDDLE * filter_width_px(samples)


class FrameRenderer:
    """Renders a scene into arrays, through a scratch file in memory.

    A render result cannot be read from Python in background mode; an uncompressed float EXR can, in 7 ms. Passes and
    camera are set once: setting them, even to what they are, makes Cycles take the whole scene over again, which costs
    as much as a frame. Moving the camera and another number of samples cost nothing.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        size_px: tuple[int, int],
        *,
        rgb: bool,
        depth: bool,
        samples: int,
        encoded_colours: bool,
    ) -> None:
        """Prepare the scene.

        size_px: width and height. samples: rays a pixel. encoded_colours: the scene emits display-encoded values.
        """
        self._scene = scene
        self._crop = (slice(size_px[1]), slice(size_px[0]))
        self._rgb = rgb
        self._depth = depth
        self._encoded_colours = encoded_colours
        self._scratch = _scratch_folder(EXR_BYTES_PER_PIXEL * size_px[0] * size_px[1])
        self._path = Path(self._scratch.name) / "frame.exr"
        layer = scene.view_layers[0]
        layer.use_pass_combined = rgb
        layer.use_pass_z = depth
        scene.cycles.samples = samples
        scene.cycles.filter_width = filter_width_px(samples)
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

    def render(self) -> RenderedFrame:
        """Render the scene as it stands.

        Raises StorageError where the scratch file could not be written, a full disk for instance.
        """
        self._path.unlink(missing_ok=True)
        problem = ""
        try:
            with muted_stdout():
                bpy.ops.render.render(write_still=True)
        except RuntimeError as error:  # how Blender reports that it could not write
            problem = str(error).strip().splitlines()[-1]
        if problem or not self._path.exists():
            raise StorageError(f"{self._path}: Blender could not write its scratch file: {problem or 'no file came'}")
        return self._read()

    def _read(self) -> RenderedFrame:
        import OpenEXR  # only who renders needs it

        with OpenEXR.File(str(self._path), separate_channels=True) as file:
            channels = {name.split(".", 1)[-1]: item.pixels[self._crop] for name, item in file.channels().items()}
        colours = None
        if self._rgb:
            colours = np.stack([channels[f"Combined.{name}"] for name in "RGB"], axis=-1)
            if not self._encoded_colours:
                colours = srgb_from_linear(colours)
        depth_m = None
        if self._depth:
            depth_m = channels["Depth.Z"]
            # Cycles gives a pixel that hits nothing 1e10, whatever the far clipping.
            depth_m = np.where(depth_m < self._scene.camera.data.clip_end, depth_m, np.float32(0))
        return RenderedFrame(colours, depth_m)


def _scratch_folder(bytes_needed: int) -> tempfile.TemporaryDirectory[str]:
    """Make a folder in memory or, where there is too little, on the disk; remove those that killed processes left."""
    folder = None
    if SHARED_MEMORY.is_dir() and os.access(SHARED_MEMORY, os.W_OK):
        for left in SHARED_MEMORY.glob(f"{SCRATCH_PREFIX}*"):
            owner = left.name.removeprefix(SCRATCH_PREFIX).split("-")[0]
            if owner.isdecimal() and not Path("/proc", owner).exists():
                shutil.rmtree(left, ignore_errors=True)
        if shutil.disk_usage(SHARED_MEMORY).free > 2 * bytes_needed:
            folder = SHARED_MEMORY
    return tempfile.TemporaryDirectory(prefix=f"{SCRATCH_PREFIX}{os.getpid()}-", dir=folder)


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
