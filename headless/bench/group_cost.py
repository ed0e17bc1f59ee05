# SPDX-License-Identifier: GPL-3.0-or-later
"""Processor time of each node group over a pass-through, in turns with it: a table on standard output.

    python headless/bench/group_cost.py PICTURE [--size 1920x1080] [--severity 3] [--turns 5] [--reference WIDTH]
        [--newly] [--only NAME ...]

PICTURE: any picture, or a lit frame of `street_frames.py`, an EXR with depth, on which groups are as on the shelf and
clip nothing; it is resized. Processor time counts all threads and, unlike the clock, little of what else the machine
does. The last column is the beginning of the SHA-256 of the bytes, to compare two versions of the program.
"""

import argparse
import hashlib
import sys
import time
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import bpy
import cv2
import numpy as np
from bench.perturbation_report import SEED, slope, step_of
from bench.results import table
from numpy.typing import NDArray
from pictures.lit_chain import LitScene
from pictures.street import LitFrame, read_frame

from noisy_world.core.machine import keep_freed_memory
from noisy_world.nodes.compositor import Compositor
from noisy_world.nodes.datablocks import new_node, set_value
from noisy_world.nodes.node_trees import ensure_group
from noisy_world.perturbations import registry
from noisy_world.perturbations.groups import build_group
from noisy_world.perturbations.kinds import ColourPerturbation


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    names = [item.name for item in registry().values() if isinstance(item, ColourPerturbation) and item.nodes]
    parser = argparse.ArgumentParser(prog="group_cost.py", description="Measure the node groups' processor time.")
    parser.add_argument("picture", type=Path, help="any picture")
    parser.add_argument("--size", default="1920x1080", help="of the frame, in pixels (default 1920x1080)")
    parser.add_argument("--reference", type=int, metavar="WIDTH", help="of the frame of which this size is a preview")
    parser.add_argument("--newly", action="store_true", help="as steps begin that are newly added")
    parser.add_argument("--severity", type=float, default=3, help="of the perturbations (default 3)")
    parser.add_argument("--turns", type=int, default=5, help="the figures are the median of so many (default 5)")
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME", help="perturbations")
    options = parser.parse_args(arguments)
    try:
        width, height = (int(part) for part in options.size.split("x"))
    except ValueError:
        parser.error(f"--size {options.size}: is no size; write WIDTHxHEIGHT")
    keep_freed_memory()  # as the generator does
    if options.picture.suffix == ".exr":
        frame = resized(read_frame(options.picture), (width, height))
        measure = partial(measured_lit, frame=frame)
    else:
        picture = cv2.imread(str(options.picture))
        if picture is None:
            parser.error(f"{options.picture}: OpenCV cannot read it")
        frame = np.asarray(cv2.resize(picture[..., ::-1], (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)
        measure = partial(measured, rgb=frame, newly=options.newly)
    reference = options.reference or width
    rows = [
        (name, *measure(name, options.severity, turns=options.turns, reference_width_px=reference))
        for name in options.only
    ]
    median_ms = float(np.median([row[1] for row in rows]))
    print(table(("perturbation", "ms over pass-through", "pass-through, ms", "bytes"), rows))
    print(f"\nMedian: {median_ms:.0f} ms.")
    return 0


def measured(
    name: str, severity: float, rgb: NDArray[np.uint8], turns: int, reference_width_px: int, *, newly: bool
) -> tuple[float, float, str]:
    """Return the milliseconds of processor time of a group over those of a pass-through, these, and a hash.

    newly: it has what a step has that is newly added; without, what presets of before have.
    """
    given = registry()[name].newly if newly else {}
    size_px = rgb.shape[1], rgb.shape[0]
    depth_m = slope(size_px)
    took_s: dict[str, list[float]] = {"none": [], "group": []}
    digest = ""
    chains = {"none": (), "group": (step_of(name, severity, **given),)}
    with Compositor(size_px, chains, reference_width_px) as compositor:
        for turn in range(turns + 1):
            for chain, taken in took_s.items():
                start_s = time.process_time()
                image, _ = compositor.perturb(rgb, {chain: (turn, (SEED, "", ""))}, depth_m)[chain]
                if turn:  # the first one makes buffers
                    taken.append(time.process_time() - start_s)
                digest = hashlib.sha256(b"" if image is None else np.ascontiguousarray(image).tobytes()).hexdigest()
    over_s = np.subtract(took_s["group"], took_s["none"])
    return 1e3 * float(np.median(over_s)), 1e3 * float(np.median(took_s["none"])), digest[:12]


def resized(frame: LitFrame, size_px: tuple[int, int]) -> LitFrame:
    """Return a lit frame at a size."""
    rgb = np.asarray(cv2.resize(frame.rgb, size_px, interpolation=cv2.INTER_LINEAR), np.float32)
    return LitFrame(rgb, np.asarray(cv2.resize(frame.depth_m, size_px, interpolation=cv2.INTER_NEAREST), np.float32))


def measured_lit(
    name: str, severity: float, frame: LitFrame, turns: int, reference_width_px: int
) -> tuple[float, float, str]:
    """Return what `measured` does of a group as on the shelf, on a lit frame."""
    height, width = frame.depth_m.shape
    perturbation = registry()[name]
    assert isinstance(perturbation, ColourPerturbation)
    took_s: tuple[list[float], list[float]] = [], []
    digest = ""
    with LitScene((width, height), 1) as passing, LitScene((width, height), 1) as scene:
        passing.write([passing.rgb])
        node = new_node(scene.tree, bpy.types.CompositorNodeGroup)
        node.node_tree = ensure_group(build_group(perturbation))
        for socket, value in (("Severity", severity), ("Reference Width", reference_width_px)):
            if socket in node.inputs:
                set_value(node.inputs[socket], value)
        for socket, source in (("Image", scene.rgb), ("Depth", scene.depth_m)):
            if socket in node.inputs:
                scene.tree.links.new(source, node.inputs[socket])
        scene.write([node.outputs["Image"]])
        for turn in range(turns + 1):
            for shown, taken in zip((passing, scene), took_s, strict=True):
                start_s = time.process_time()
                (image,) = shown.run(frame, turn)
                if turn:  # the first one makes buffers
                    taken.append(time.process_time() - start_s)
                digest = hashlib.sha256(image.tobytes()).hexdigest()
    over_s = np.subtract(took_s[1], took_s[0])
    return 1e3 * float(np.median(over_s)), 1e3 * float(np.median(took_s[0])), digest[:12]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
