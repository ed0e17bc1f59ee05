# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the asset library: every perturbation of colour as a compositor node group, for Blender's asset browser.

    python headless/tools/assets.py [--out FOLDER]

The groups work without the add-on: append one, or point Blender's preferences at the folder, and drag it from the
compositor's asset shelf.
"""

import argparse
import sys
import uuid
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import bpy
import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.blender.nodes import ensure_group
from noisy_world.blender.render import muted_output
from noisy_world.core.node_graphs.groups import build_group
from noisy_world.core.perturbing.kinds import COLOUR_STAGES, ColourPerturbation
from tools.showcase import demo_frame, perturbed, shown_perturbations

FILE = "noisy_world_assets.blend"
CATALOGS = "blender_assets.cats.txt"
CATALOG_NAMES = {"environment": "Environment", "lens": "Lens", "sensor": "Sensor", "post": "Post-processing"}
PREVIEW_SEVERITY = 4
PREVIEW_PX = 256


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="assets.py", description="Write the library of node groups.")
    parser.add_argument("--out", type=Path, default=ROOT / "addon/noisy_world/assets", help="the library's folder")
    options = parser.parse_args(arguments)
    count = write_library(options.out)
    print(f"wrote {options.out / FILE}: {count} node groups")
    return 0


def write_library(folder: Path) -> int:
    """Write the file and its catalogues; return the number of groups."""
    previews = perturbed(*demo_frame(), [PREVIEW_SEVERITY])
    with muted_output():
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    shown = shown_perturbations()
    for perturbation in shown:
        mark(perturbation, previews[perturbation.name, PREVIEW_SEVERITY])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / CATALOGS).write_text(catalogs(), encoding="utf-8")
    with muted_output():
        bpy.ops.wm.save_as_mainfile(filepath=str((folder / FILE).resolve()), compress=True, copy=True)
    return len(shown)


def mark(perturbation: ColourPerturbation, picture: NDArray[np.uint8]) -> None:
    """Make a perturbation's group an asset with everything that the asset browser shows."""
    graph = build_group(perturbation)
    tree = ensure_group(graph)
    tree.asset_mark()
    asset = tree.asset_data
    assert asset is not None
    asset.description = tree.description
    asset.author = "Noisy World"
    asset.license = "GPL-3.0-or-later"
    asset.catalog_id = catalog_id(perturbation.stage)
    for tag in graph.tags:
        asset.tags.new(tag)
    # A square from the middle, upright: Blender's rows go up.
    side = min(picture.shape[:2])
    top, left = (picture.shape[0] - side) // 2, (picture.shape[1] - side) // 2
    square = np.ascontiguousarray(picture[top : top + side, left : left + side])
    small = cv2.resize(square, (PREVIEW_PX, PREVIEW_PX), interpolation=cv2.INTER_AREA)[::-1]
    rgba = np.ones((PREVIEW_PX, PREVIEW_PX, 4), dtype=np.float32)
    rgba[..., :3] = small / np.float32(255)
    preview = tree.preview_ensure()
    size: Any = (PREVIEW_PX, PREVIEW_PX)  # the stubs have arrays of Blender's own only
    values: Any = rgba.ravel()
    preview.image_size = size
    preview.image_pixels_float.foreach_set(values)


def catalog_id(stage: str) -> str:
    """Return a catalogue's identifier, always the same."""
    return str(uuid.uuid5(uuid.NAMESPACE_URL, f"noisy-world/{stage}"))


def catalogs() -> str:
    """Return the text of the catalogue file."""
    lines = ["VERSION 1", ""]
    for stage in COLOUR_STAGES:
        name = CATALOG_NAMES[stage]
        lines.append(f"{catalog_id(stage)}:Noisy World/{name}:Noisy World-{name}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
