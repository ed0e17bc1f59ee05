# SPDX-License-Identifier: GPL-3.0-or-later
"""The perturbations as a library: one array, or the frames of a sequence that exists. No Blender is needed.

from noisy_world.perturb import apply, frames

foggy = apply(rgb, "fog", severity=3, seed=7, frame=12)
for item in frames("Replica/room0", [{"fog": {"severity": 3}}, {"desync": {"offset": 5}}], seed=7):
    track(item.rgb, item.depth_m)
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .core.datasets.layouts import find_sequence
from .core.perturbing.mixture import Setting, parse_steps, perturb_colour, perturb_depth, perturb_motion, perturb_rgb
from .core.planning.plan import lay_out
from .core.schema import Place
from .perturbations import registry


def apply[Pixel: (np.uint8, np.float32)](
    image: NDArray[Pixel],
    name: str,
    *,
    seed: int = 0,
    frame: int = 0,
    depth_m: NDArray[np.float32] | None = None,
    **values: Any,
) -> NDArray[Pixel]:
    """Perturb one colour or depth image; the input is left alone.

    image: (H, W, 3) RGB, sRGB-encoded, uint8 or float32 in [0, 1], for a perturbation of colour; (H, W) float32 planar
    depth in metres, 0 = void, for one of depth. The result has the same shape and type.
    name: of the perturbation, such as "fog". seed, frame: name the random stream; the same ones, the same pixels.
    depth_m: (H, W) float32 planar depth, 0 = void, for the perturbations of colour that depend on it.
    values: as in a preset: severity (0, or 1 to 5), mode, levels, temporal, or single parameters.

    Raises InputError for a name or a value that does not exist, TypeError for an array of another kind.
    """
    (step,) = parse_steps([{name: values}], Place("apply"), registry())
    category = step.perturbation.category
    identifiers = (seed, "", "")
    if category in ("motion", "sync"):
        raise TypeError(f"{name} acts on a whole sequence, not on an image")
    if category == "depth":
        _check(image, image.ndim == 2 and image.dtype == np.float32, "(H, W) float32")
        depth_m, _ = perturb_depth([step], image, frame, identifiers)  # type: ignore[arg-type]
        return image.copy() if depth_m is None else depth_m  # type: ignore[return-value]
    kinds = (np.uint8, np.float32)
    _check(image, image.ndim == 3 and image.shape[2] == 3 and image.dtype in kinds, "(H, W, 3) uint8 or float32")
    if image.dtype == np.uint8:
        pixels, _ = perturb_rgb([step], image, frame, identifiers, depth_m)
        return image.copy() if pixels is None else pixels  # type: ignore[return-value]
    where = step.frame(frame, identifiers)
    severity = step.severity_of(where)
    if severity == 0:
        return image.copy()
    made = perturb_colour(step, image, severity, where, depth_m)  # type: ignore[arg-type]
    return np.clip(made, 0.0, 1.0)  # type: ignore[return-value]


def _check(image: NDArray[Any], fits: bool, wanted: str) -> None:
    if not fits:
        raise TypeError(f"the image is {image.dtype} {image.shape}, but has to be {wanted}")


@dataclass(frozen=True)
class PerturbedFrame:
    """A frame of a perturbed sequence.

    index: its number there. stamp_s: its time stamp, seconds. c2w: (4, 4) float64 camera-to-world of its colour, OpenCV
    axes, metres. rgb: (H, W, 3) uint8, RGB. depth_m: (H, W) float32 planar depth in metres, 0 = void.
    """

    index: int
    stamp_s: float
    c2w: NDArray[np.float64]
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]


def frames(
    folder: str | Path,
    perturb: Sequence[Mapping[str, Any]],
    *,
    seed: int = 0,
    setting: str = "setting",
    scene: str | None = None,
) -> Iterator[PerturbedFrame]:
    """Perturb a sequence in any layout, frame by frame, without writing anything.

    perturb: as in a preset, such as [{"fog": {"severity": 3}}]. seed, setting, scene (default: the folder's name): name
    the random streams; a preset with the same ones makes the same pixels.

    Raises InputError for a folder that holds no sequence, and for what a preset could not say either.
    """
    existing = find_sequence(Path(folder))
    steps = parse_steps(perturb, Place("frames"), registry())
    for step in steps:
        if step.perturbation.name == "motion_deviation":
            raise Place("frames").error("motion_deviation needs a mesh: a sequence cannot be seen from elsewhere")
    name = Path(folder).name if scene is None else scene
    whole = Setting(setting, steps)
    sequence = lay_out(whole, name, len(existing.trajectory), (seed, name, setting))
    faster = whole.named("faster_motion")
    path = existing.trajectory
    path = path if faster is None else perturb_motion(faster, path, sequence.identifiers)
    for index in sequence.frames:
        source = sequence.depth_source(index)
        rgb, depth_m = existing.frame(sequence.rgb_source(index)).rgb, existing.frame(source).depth_m
        seen_m = existing.frame(sequence.rgb_source(index)).depth_m if whole.needs_depth else None
        new_rgb, _ = perturb_rgb(whole.rgb, rgb, index, sequence.identifiers, seen_m)
        new_depth_m, _ = perturb_depth(whole.depth, depth_m, source // sequence.every, sequence.identifiers)
        yield PerturbedFrame(
            index,
            float(path.stamps_s[index]),
            path.c2w[index],
            rgb if new_rgb is None else new_rgb,
            depth_m if new_depth_m is None else new_depth_m,
        )
