# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering a scene of one's own into float arrays, pass by pass, through a scratch file in memory."""

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.errors import StorageError
from ..core.scratch import ScratchFolder
from .render import muted_output
from .scratch_images import write_plain_floats
from .typed import override

BYTES_PER_PIXEL = 36  # nine channels of float32, as where a denoiser keeps what it was given


class RenderFile:
    """The file that a scene is rendered into."""

    def __init__(self, scene: bpy.types.Scene, size_px: tuple[int, int]) -> None:
        """Prepare the scene. size_px: width, height of the frames, which stand at the left top of the image."""
        self._scene = scene
        self._crop = (slice(size_px[1]), slice(size_px[0]))
        self._scratch = ScratchFolder(BYTES_PER_PIXEL * size_px[0] * size_px[1])
        self.folder = self._scratch.path
        self._path = self.folder / "frame.exr"
        render = scene.render
        render.filepath = str(self._path)
        render.use_file_extension = False
        render.use_overwrite = True
        render.use_placeholder = False
        write_plain_floats(render.image_settings)

    def render(self, layer: str) -> dict[str, NDArray[np.float32]]:
        """Render the scene as it is, and return a layer's channels (H, W) by pass and channel, such as "Depth.Z".

        Raises StorageError where the scratch file could not be written, for instance on a full disk.
        """
        import OpenEXR  # needed only for rendering

        self._path.unlink(missing_ok=True)
        problem = ""
        try:
            with muted_output(), override(scene=self._scene):
                bpy.ops.render.render(write_still=True)
        except RuntimeError as error:  # Blender reports in this way that it could not write
            problem = str(error).strip().splitlines()[-1]
        if problem or not self._path.exists():
            raise StorageError(
                f"Blender could not write its scratch file: {problem or 'no file came'}", file=self._path
            )
        with OpenEXR.File(str(self._path), separate_channels=True) as file:
            named = {tuple(name.rsplit(".", 2)): item.pixels[self._crop] for name, item in file.channels().items()}
        return {".".join(name[1:]): pixels for name, pixels in named.items() if name[0] == layer}

    def close(self) -> None:
        """Remove the scratch file."""
        self._scratch.remove()
