# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the asset library: every perturbation of colour as a compositor node group, for Blender's asset browser.

    python headless/tools/assets.py [--out FOLDER]

The groups work without the add-on: append one, or point Blender's preferences at the folder, and drag it from the
compositor's asset shelf.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import uuid

import bpy
import cv2
import numpy as np
from numpy.typing import NDArray

from noisy_world.core.errors import american, title
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.node_graph import Graph
from noisy_world.core.schema import ConfigPath
from noisy_world.nodes.chain import slider_capacities
from noisy_world.nodes.datablocks import muted_output
from noisy_world.nodes.node_trees import ensure_group, index_of
from noisy_world.panel.gallery import BENCHMARK, list_of
from noisy_world.perturbations import registry
from noisy_world.perturbations.groups import build_group
from noisy_world.perturbations.kinds import COLOUR_STAGES, ColourPerturbation
from noisy_world.perturbations.parsing import parse_steps
from pictures.gallery import shown_perturbations
from pictures.lit_chain import ColourStep, perturbed, shown
from pictures.street import FOCAL_WIDTHS, LitFrame, read_frame, write_frame

FILE = "noisy_world_assets.blend"
INDEX = "noisy_world_assets.json"
CATALOGS = "blender_assets.cats.txt"
CATALOG_NAMES = {"environment": "Environment", "lens": "Lens", "sensor": "Sensor", "post": "Post-processing"}
# How the previews are made, chosen so that one tells a group from another in a small picture: with these values of a
# preset where severity SEVERITY is too much or too little, and with sizes in pixels as in a frame of this width.
LOOKS: dict[str, dict[str, Any]] = {
    "fog_depth": {"visibility_m": 50.0, "airlight": 0.6, "falloff_m": 8.0, "glow": 0.6, "unevenness": 0.6},
    "defocus_depth": {"focus_m": 7.0, "f_number": 0.7, "focal_length_mm": 85.0, "max_radius_px": 10.0},
    "gaussian_noise": {"severity": 3},
    "shot_noise": {"severity": 3},
    "brightness": {"severity": 3},
    "contrast": {"severity": 2},
    "lens_frost": {"severity": 2},
    "jpeg_compression": {"severity": 5},
}
SEVERITY = 4
REFERENCES_PX = {"pixelate": 110, "jpeg_compression": 200, "gaussian_blur": 250, "spatter": 300, "lens_drops": 260}
REFERENCE_PX = 420
MOMENT = 30  # a frame at which what drifts is under way


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="assets.py", description="Write the library of node groups.")
    parser.add_argument("--out", type=Path, default=ROOT / "addon/noisy_world/assets", help="the library's folder")
    parser.add_argument(
        "--frame", type=Path, help="of the street, an EXR of 1200 x 680: cut the previews' picture anew"
    )
    options = parser.parse_args(arguments)
    if options.frame is not None:
        write_frame(STORED, cut(read_frame(options.frame)), exact_depth=False)
    count = write_library(options.out)
    print(f"wrote {options.out / FILE}: {count} node groups")
    return 0


def write_library(folder: Path) -> int:
    """Write the file, its catalogues and its index; return the number of groups."""
    with muted_output():
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    pictures = previews()
    for perturbation in shown_perturbations():
        mark(perturbation, pictures[perturbation.name])
    graphs = [build_group(perturbation) for perturbation in shown_perturbations()]
    for graph in larger_groups():  # no assets: the panel's sliders meet them
        ensure_group(graph).use_fake_user = True
        graphs.append(graph)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / CATALOGS).write_text(catalogs(), encoding="utf-8")
    with muted_output():
        bpy.ops.wm.save_as_mainfile(filepath=str((folder / FILE).resolve()), compress=True, copy=True)
    index = index_of(folder / FILE, {ensure_group(graph).name: graph for graph in graphs})
    (folder / INDEX).write_text(index, encoding="utf-8")
    return len(pictures)


def larger_groups() -> list[Graph]:
    """Return the groups of larger capacities that sliders of the panel meet."""
    return [build_group(item, larger) for item in shown_perturbations() for larger in slider_capacities(item)]


def previews() -> dict[str, NDArray[np.uint8]]:
    """Return what each group makes of a lit frame, square, by the perturbation's name."""
    steps = {item.name: look_step(item.name) for item in shown_perturbations()}
    widths_px = {name: REFERENCES_PX.get(name, REFERENCE_PX) for name in steps}
    made = perturbed(thumbnail(), MOMENT, steps, widths_px, thumbnail_camera())
    return {name: shown(linear) for name, linear in made.items()}


def look_step(name: str) -> ColourStep:
    """Return the step that a perturbation's preview shows."""
    (step,) = parse_steps([{name: LOOKS.get(name, {"severity": SEVERITY})}], ConfigPath("assets"), registry())
    return step


def mark(perturbation: ColourPerturbation, picture: NDArray[np.uint8]) -> None:
    """Make a perturbation's group an asset with everything that the asset browser shows."""
    graph = build_group(perturbation)
    tree = ensure_group(graph)
    tree.asset_mark()
    asset = tree.asset_data
    assert asset is not None
    asset.description = description_of(perturbation)
    asset.author = "Noisy World"
    asset.license = "GPL-3.0-or-later"
    asset.catalog_id = catalog_id(*catalog_of(perturbation))
    for tag in (*graph.tags, *tags_of(perturbation)):
        asset.tags.new(tag)
    rgba = np.ones((SIDE_PX, SIDE_PX, 4), dtype=np.float32)
    rgba[..., :3] = picture[::-1] / np.float32(255)  # Blender stores rows from the bottom up
    preview = tree.preview_ensure()
    size: Any = (SIDE_PX, SIDE_PX)  # the stubs have arrays of Blender's own only
    values: Any = rgba.ravel()
    preview.image_size = size
    preview.image_pixels_float.foreach_set(values)


def description_of(perturbation: ColourPerturbation) -> str:
    """Return what an asset's tooltip says: what is seen, what has to be linked, what moves, and the physical twin."""
    said = [american(perturbation.sentence)]
    if perturbation.needs_depth:
        said.append("Link the Depth pass to it")
    if "drift" in perturbation.group_temporals:
        said.append("Its pattern moves with the scene's frames")
    if (twin := registry().get(perturbation.about.twin)) is not None:
        said.append(f"Laid over the image as in the benchmark; its physical twin is {title(twin.label)}")
    return ". ".join(said)


def tags_of(perturbation: ColourPerturbation) -> tuple[str, ...]:
    """Return what else it is found by: the list that it is of, what it takes, and how it changes."""
    benchmark = list_of(perturbation) == BENCHMARK
    found = {"benchmark": benchmark, "physical": not benchmark, "depth": perturbation.needs_depth}
    found |= {"animated": bool(perturbation.group_temporals), "camera": perturbation.uses_motion}
    return tuple(tag for tag, holds in found.items() if holds)


def catalog_of(perturbation: ColourPerturbation) -> tuple[str, ...]:
    """Return the stage, and for what is laid over images as in the benchmark the part of it that holds these."""
    return (perturbation.stage, "benchmark") if list_of(perturbation) == BENCHMARK else (perturbation.stage,)


def catalog_id(*names: str) -> str:
    """Return a catalogue's identifier, which never changes. names: of the stage, and of its part."""
    return str(uuid.uuid5(uuid.NAMESPACE_URL, "/".join(("noisy-world", *names))))


def catalogs() -> str:
    """Return the text of the catalogue file."""
    lines = ["VERSION 1", ""]
    for stage in COLOUR_STAGES:
        name = CATALOG_NAMES[stage]
        lines.append(f"{catalog_id(stage)}:Noisy World/{name}:Noisy World-{name}")
        if any(catalog_of(item) == (stage, "benchmark") for item in shown_perturbations()):
            part = f"{name}/Benchmark:Noisy World-{name}-Benchmark"
            lines.append(f"{catalog_id(stage, 'benchmark')}:Noisy World/{part}")
    return "\n".join(lines) + "\n"


# --- the part of a frame of the street that the groups' previews are made on ---


FRAME_PX = (1200, 680)
CUT_PX = (480, 90, 512)  # column, row and side of the part; chosen by eye: a lamp, cars, sky, near and far
SIDE_PX = 256  # the size that Blender stores previews in
GAIN = 1.7  # chosen, for small pictures on a grey ground
STORED = ROOT / "headless/pictures/thumbnail.exr"


def cut(frame: LitFrame) -> LitFrame:
    """Return the part of a frame of FRAME_PX, smaller; depth is that of single pixels, as it cannot be averaged."""
    left, top, side = CUT_PX
    rgb = frame.rgb[top : top + side, left : left + side] * np.float32(GAIN)
    small = np.asarray(cv2.resize(rgb, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA), np.float32)
    step = side // SIDE_PX
    return LitFrame(small, frame.depth_m[top : top + side : step, left : left + side : step])


def thumbnail() -> LitFrame:
    """Return the frame of the previews."""
    return read_frame(STORED)


def thumbnail_camera() -> Intrinsics:
    """Return its intrinsics, but for the middle, which is taken to be the picture's."""
    focal_px = FOCAL_WIDTHS * FRAME_PX[0] * SIDE_PX / CUT_PX[2]
    return Intrinsics(SIDE_PX, SIDE_PX, focal_px, focal_px, (SIDE_PX - 1) / 2, (SIDE_PX - 1) / 2)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
