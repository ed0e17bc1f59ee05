# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering frames in Blender into float arrays: colour and planar depth, each only if asked for."""

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.channels.surface import Fact, Surface
from ..core.errors import StorageError
from ..core.planning.source import RenderedFrame
from ..core.scratch import ScratchFolder
from ..core.utf8_names import utf8_name
from .read_lines import Band, bordered
from .scratch_images import muted_output, write_plain_floats
from .typed import camera_of, override_scene

FAR_PLANE_TOLERANCE = 1e-4  # of the far plane's distance; chosen: a z-buffer rounds depths next to it by less
EXR_BYTES_PER_PIXEL = 20  # five channels of float32
BYTES_PER_PIXEL = 36  # nine channels, as where a denoiser keeps what it was given
SURFACE_BYTES_PER_PIXEL = 28  # seven more: a normal, and a face with its alpha
FACE_OUTPUT = "Noisy World face"
FACE_ATTRIBUTE = "noisy_world_face"
FACE_STEP = 4096  # a face's number is told in two parts below this, which float32 holds exactly; chosen


@dataclass(frozen=True)
class Passes(RenderedFrame):
    """What a render gives. world: of the surface, where it is asked for; normals in the scene's axes."""

    world: Surface | None = None


class RenderFile:
    """The scratch file, in memory, that a scene is rendered into.

    In background mode Python cannot read a render result, but it can read an uncompressed float EXR, in 7 ms.
    """

    def __init__(
        self, scene: bpy.types.Scene, size_px: tuple[int, int], bytes_per_pixel: int = BYTES_PER_PIXEL
    ) -> None:
        """Prepare the scene. size_px: width, height of the frames, which stand at the left top of the image."""
        self._scene = scene
        self.size_px = size_px
        self._scratch = ScratchFolder(bytes_per_pixel * size_px[0] * size_px[1])
        self.folder = self._scratch.path
        self._path = self.folder / "frame.exr"
        render = scene.render
        render.filepath = utf8_name(self._path)
        render.use_file_extension = False
        render.use_overwrite = True
        render.use_placeholder = False
        write_plain_floats(render.image_settings)

    def render(
        self, layer: str, size_px: tuple[int, int] | None = None, *, band: Band | None = None
    ) -> dict[str, NDArray[np.float32]]:
        """Render the scene as it is, and return a layer's channels (H, W) by pass and channel, such as "Depth.Z".

        size_px: width, height of this frame, where they are not those that were given. band: the lines of it that are
        rendered and returned; None for all.
        Raises StorageError where the scratch file could not be written, for instance on a full disk.
        """
        import OpenEXR  # needed only for rendering

        self._path.unlink(missing_ok=True)
        problem, crop = "", (slice(0), slice(0))
        try:
            with (
                bordered(self._scene, size_px or self.size_px, band) as crop,
                muted_output(),
                override_scene(self._scene),
            ):
                bpy.ops.render.render(write_still=True)
        except RuntimeError as error:  # Blender reports in this way that it could not write
            problem = str(error).strip().splitlines()[-1]
        if problem or not self._path.exists():
            raise StorageError(
                f"Blender could not write its scratch file: {problem or 'no file came'}", file=self._path
            )
        with OpenEXR.File(utf8_name(self._path), separate_channels=True) as file:
            named = {tuple(name.rsplit(".", 2)): item.pixels[crop] for name, item in file.channels().items()}
        return {".".join(name[1:]): pixels for name, pixels in named.items() if name[0] == layer}

    def close(self) -> None:
        """Remove the scratch file."""
        self._scratch.remove()


class FrameRenderer:
    """Renders a scene into arrays.

    Passes and camera are set once: setting them, even to equal values, makes Cycles load the whole scene again, which
    takes as long as a frame. Moving the camera and changing the number of samples cost nothing.
    """

    def __init__(
        self,
        scene: bpy.types.Scene,
        size_px: tuple[int, int],
        *,
        rgb: bool,
        depth: bool,
        encoded_colours: bool,
        facts: frozenset[Fact] = frozenset(),
    ) -> None:
        """Prepare the scene.

        size_px: width, height. rgb, depth: what is rendered. encoded_colours: the scene shows display-encoded values.
        facts: what is told of the surface, with Cycles; for faces their materials have to say it (`tell_faces`).
        """
        self._scene = scene
        self._rgb = rgb
        self._depth = depth
        self._encoded_colours = encoded_colours
        self._facts = facts
        bytes_per_pixel = EXR_BYTES_PER_PIXEL + (SURFACE_BYTES_PER_PIXEL if facts else 0)
        self._file = RenderFile(scene, size_px, bytes_per_pixel)
        layer = scene.view_layers[0]
        layer.use_pass_combined = rgb
        layer.use_pass_z = depth
        layer.use_pass_normal = "normals" in facts
        if "faces" in facts:
            face = layer.aovs.add()
            face.name, face.type = FACE_OUTPUT, "COLOR"
        self._layer = layer.name

    def close(self) -> None:
        """Remove the scratch file."""
        self._file.close()

    def render(self, size_px: tuple[int, int] | None = None) -> Passes:
        """Render the scene in its current state. size_px: width, height, where they are not those that were given.

        Raises StorageError where the scratch file could not be written, for instance on a full disk.
        """
        channels = self._file.render(self._layer, size_px)
        colours = None
        if self._rgb:
            colours = np.stack([channels[f"Combined.{name}"] for name in "RGB"], axis=-1)
            if not self._encoded_colours:
                colours = srgb_from_linear(colours)
        depth_m = None
        if self._depth:
            depth_m = channels["Depth.Z"]
            # Where nothing is hit, depth is the far plane's or, with Cycles, 1e10.
            far_m = camera_of(self._scene.camera).clip_end * (1 - FAR_PLANE_TOLERANCE)
            depth_m = np.where(depth_m < far_m, depth_m, np.float32(0))
        return Passes(colours, depth_m, world=self._surface(channels) if self._facts else None)

    def _surface(self, channels: dict[str, NDArray[np.float32]]) -> Surface:
        normals = faces = None
        if "normals" in self._facts:
            normals = np.stack([channels[f"Normal.{name}"] for name in "XYZ"], axis=-1)
        if "faces" in self._facts:
            low, high, hit = (np.rint(channels[f"{FACE_OUTPUT}.{name}"]).astype(np.int32) for name in "RGB")
            faces = np.where(hit > 0, high * FACE_STEP + low, -1).astype(np.int32)
        return Surface(normals, faces)


def srgb_from_linear(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """Encode linear light (any shape, float32) for a display (IEC 61966-2-1)."""
    power = np.maximum(linear, np.float32(0.0031308)) ** np.float32(1 / 2.4)
    return np.where(
        linear <= np.float32(0.0031308), linear * np.float32(12.92), np.float32(1.055) * power - np.float32(0.055)
    )
