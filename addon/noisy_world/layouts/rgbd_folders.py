# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of colour beside a folder of depth, and nothing that says more: what most scripts write.

Images of one name belong together. Nothing says times and poses; `camera-intrinsics.txt` or `intrinsic.txt` may say
the camera, or the preset does.
"""

from collections import Counter
from pathlib import Path

from . import EVERY
from .described import DepthFilesSpec, DescribedLayout, ImageFilesSpec, SequenceSpec, Told
from .layout import stated_camera
from .numbered import Cameras

COLOURS = ("rgb", "color", "colour", "image", "images")
DEPTH = "depth"
COLOUR_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm")
DEPTH_SUFFIXES = (".png", ".npy", ".npz", ".exr", ".tif", ".tiff")


class RgbdFoldersLayout(DescribedLayout):
    """`rgb/NAME.png` and `depth/NAME.png`."""

    name = "rgbd_folders"
    order = 900
    label = "RGB-D Folders"
    meaning = "colour and depth in folders, without times and poses, where no other layout is told by the files"
    files = "rgb/NAME.png (or color/, image/, images/), depth/NAME.png (or .npy, .exr, .tiff)"
    told_by = ()
    described = SequenceSpec()

    def recognises(self, folder: Path) -> bool:
        """Tell whether there are both folders with images, and nothing that another layout is told by."""
        if _suffix(folder / DEPTH, DEPTH_SUFFIXES) is None or len(_colours(folder)) != 1:
            return False
        return not any(layout.recognises(folder) for name, layout in EVERY.items() if name != self.name)

    def description(self, folder: Path) -> SequenceSpec:
        """Return where the images are, of the suffix that most of them have."""
        (colour,) = _colours(folder)
        rgb, depth = _suffix(folder / colour, COLOUR_SUFFIXES), _suffix(folder / DEPTH, DEPTH_SUFFIXES)
        return SequenceSpec(rgb=ImageFilesSpec(f"{colour}/*{rgb}"), depth=DepthFilesSpec(f"{DEPTH}/*{depth}"))

    def tell(self, folder: Path, images: tuple[Path, ...]) -> Told:
        """Return the camera that a file says, if any does."""
        stated = stated_camera(folder, images[0])
        cameras = Cameras() if stated is None else Cameras(*stated)
        return Told(cameras, notes=("nothing says poses: a mapping as the preset's sequence may name a file of them",))


def _colours(folder: Path) -> list[str]:
    return [name for name in COLOURS if _suffix(folder / name, COLOUR_SUFFIXES) is not None]


def _suffix(folder: Path, suffixes: tuple[str, ...]) -> str | None:
    """Return the suffix that most images of a folder have; None where it has none."""
    if not folder.is_dir():
        return None
    found = Counter(path.suffix for path in folder.iterdir() if path.suffix.lower() in suffixes)
    return found.most_common(1)[0][0] if found else None


LAYOUT = RgbdFoldersLayout()
