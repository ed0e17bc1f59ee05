# SPDX-License-Identifier: GPL-3.0-or-later
"""The perturbations as a library: for one image, or for the frames of a recording. No Blender is needed.

from noisy_world.perturb import apply, frames

foggy = apply(rgb, "fog", severity=3, seed=7, frame=12)
for item in frames("Replica/room0", [{"fog": {"severity": 3}}, {"desync": {"offset": 5}}], seed=7):
    track(item.rgb, item.depth_m)
"""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .core.datasets.images import as_float
from .core.geometry import Intrinsics
from .core.perturbing.execution import perturb_colour, perturb_depth, perturb_rgb, split_motion
from .core.perturbing.kinds import SEQUENCE_KINDS, DepthPerturbation, FrameContext
from .core.perturbing.reading import parse_steps
from .core.perturbing.steps import Setting, Step
from .core.planning.sequence import lay_out, written_paths
from .core.schema import Place
from .core.trajectories.sensor_paths import SensorPaths
from .perturbations import registry
from .pipeline.clean_frame import Camera, CleanFrame
from .sources.recording import RecordedFrame, read_recording


def apply[Pixel: (np.uint8, np.float32)](
    image: NDArray[Pixel],
    name: str,
    *,
    seed: int = 0,
    frame: int = 0,
    depth_m: NDArray[np.float32] | None = None,
    rgb: NDArray[Any] | None = None,
    intrinsics: Intrinsics | None = None,
    stamp_s: float | None = None,
    **values: Any,
) -> NDArray[Pixel]:
    """Perturb one colour or depth image; the input is not changed.

    image: (H, W, 3) RGB, sRGB-encoded, uint8 or float32 in [0, 1], for a perturbation of colour; (H, W) float32 planar
    depth in metres, 0 = void, for one of depth. The result has the same shape and type.
    name: of the perturbation, such as "fog". seed, frame: decide the random stream; equal ones give equal pixels.
    depth_m: (H, W) float32 planar depth, 0 = void, for the perturbations of colour that depend on it. rgb: (H, W, 3) as
    an image of colour, for the perturbations of depth that depend on it. intrinsics, stamp_s: of the image, for
    perturbations that ask for them; stamp_s in seconds.
    values: as in a preset: severity (0, or 1 to 5), mode, levels, temporal, or single parameters.

    Raises InputError for a name or a value that does not exist, TypeError for an array of another kind.
    """
    (step,) = parse_steps([{name: values}], Place("apply"), registry())
    if isinstance(step.perturbation, SEQUENCE_KINDS):
        raise TypeError(f"{name} acts on a whole sequence, not on an image")
    where = FrameContext(
        frame,
        (seed, "", ""),
        stamp_s=stamp_s,
        intrinsics=intrinsics,
        read_rgb=None if rgb is None else lambda: as_float(rgb),
        read_depth_m=None if depth_m is None else lambda: depth_m,
    )
    return _perturbed(step, image, where)


def _perturbed(step: Step[Any], image: NDArray[Any], where: FrameContext) -> NDArray[Any]:
    """Return the image, of the same type, after a step of colour or depth."""
    if isinstance(step.perturbation, DepthPerturbation):
        _check(image, image.ndim == 2 and image.dtype == np.float32, "(H, W) float32")
        made_m, _ = perturb_depth([step], image, where)
        return image.copy() if made_m is None else made_m
    kinds = (np.uint8, np.float32)
    _check(image, image.ndim == 3 and image.shape[2] == 3 and image.dtype in kinds, "(H, W, 3) uint8 or float32")
    if image.dtype == np.uint8:
        pixels, _ = perturb_rgb([step], image, where)
        return image.copy() if pixels is None else pixels
    context = step.context(where)
    severity = step.severity_of(context)
    if severity == 0:
        return image.copy()
    made = perturb_colour(step, image, severity, context)
    return np.clip(made, 0.0, 1.0)


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
    intrinsics: Intrinsics | None = None,
    rate_hz: float | None = None,
) -> Iterator[PerturbedFrame]:
    """Perturb a sequence in any layout, frame by frame, without writing anything.

    perturb: as in a preset, such as [{"fog": {"severity": 3}}]. seed, setting, scene (default: the folder's name):
    decide the random streams; a preset with equal ones makes equal pixels. intrinsics: of the sequence's camera, for
    perturbations that ask for them; default: what its files say, if they do. rate_hz: of a sequence that has no time
    stamps; default 20. Warns of images without a partner, which are left out.

    Raises InputError for a folder that holds no sequence, for values that a preset could not have, and for intrinsics
    or a rate that the sequence's own files contradict.
    """
    recording = read_recording(Path(folder), Place("frames"), rate_hz)
    stored = recording.stored
    for note in stored.notes:
        warnings.warn(f"{folder}: {note}", stacklevel=2)
    known = stored.known_camera if intrinsics is None else recording.camera(intrinsics)
    whole = Setting(setting, parse_steps(perturb, Place("frames"), registry()))
    moving, _ = split_motion(whole.motion)
    if moving:
        name = moving[-1].perturbation.name
        raise Place("frames").error(f"{name} needs a mesh: a sequence cannot be seen from elsewhere")
    name = Path(folder).name if scene is None else scene
    sequence = lay_out(whole, name, len(stored.trajectory), (seed, name, setting))
    path = written_paths(sequence, SensorPaths(stored.trajectory)).rgb
    camera, depth_camera = (Camera(known, part.seconds) for part in (stored.stamps.rgb, stored.stamps.depth))
    for index in sequence.frames:
        shown = sequence.shown(index)
        clean = CleanFrame(shown.rgb_source, RecordedFrame(stored.frame(shown.rgb_source)))
        taken = CleanFrame(shown.depth_source, RecordedFrame(stored.frame(shown.depth_source)))
        rgb, _ = perturb_rgb(whole.rgb, clean.rgb, camera.context(sequence, index, clean))
        depth_m, _ = perturb_depth(whole.depth, taken.depth_m, depth_camera.context(sequence, shown.depth_frame, taken))
        yield PerturbedFrame(
            index,
            float(path.stamps_s[index]),
            path.c2w[index],
            clean.byte_rgb() if rgb is None else rgb,
            taken.depth_m if depth_m is None else depth_m,
        )
