# SPDX-License-Identifier: GPL-3.0-or-later
"""What a meter saw of a scene's frames, kept in the file, and what automatics decide by it frame by frame."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import bpy
import numpy as np
from numpy.typing import NDArray

from ..blender.chain_values import DecidedAt
from ..core.node_graphs.chain import decided_by
from ..core.perturbing.kinds import FrameContext
from ..core.planning.sequence import PlannedSequence
from ..pipeline.clean_frame import Camera
from ..pipeline.earlier import EarlierFrames, GreyFrames
from ..pipeline.made_frame import CleanFrames, Frame
from .paths import clean_stamps_s
from .properties import panel_of
from .stills import path_frames

KEPT = "noisy_world_metered"  # of a scene: which frames of what were metered, and their light

Lights: TypeAlias = Mapping[float, NDArray[np.float32]]
"""By scene frame: what a meter saw of it, (h, w, 3) linear light."""


@dataclass(frozen=True)
class _Known:
    """What was decided last. made_from: what it follows from. by_frame: of each frame that was asked for."""

    made_from: list[Any]
    by_frame: dict[int, Mapping[str, FrameContext]]


_grey: set[int] = set()  # scenes whose preview follows mid-grey, as some of their frames were not metered
_known: dict[int, _Known] = {}  # by scene: a slider of another step decides nothing anew


def keep(scene: bpy.types.Scene, lights: Mapping[int, NDArray[np.float32]]) -> None:
    """Keep what a meter saw of source frames of the panel's path, in place of what was kept before."""
    frames = path_frames(scene)
    images = np.stack([lights[source] for source in sorted(lights)]).astype("<f4")
    scene[KEPT] = {
        "shows": panel_of(scene).mesh_source,
        "frames": [float(frames[source]) for source in sorted(lights)],
        "size": list(images.shape[1:3]),
        "light": images.tobytes(),
    }


def lights_of(scene: bpy.types.Scene, sequence: PlannedSequence) -> list[NDArray[np.float32]] | None:
    """Return what a meter saw of each source frame of the path; None where one that is shown was not metered."""
    kept: Any = scene.get(KEPT)
    if kept is None or kept["shows"] != panel_of(scene).mesh_source:
        return None
    images = np.frombuffer(kept["light"], "<f4").reshape(len(kept["frames"]), *kept["size"], 3)
    by_frame = dict(zip(kept["frames"], images, strict=True))
    found = [by_frame.get(float(frame)) for frame in path_frames(scene)]
    shown = [found[source] for source in set(sequence.source_frames)]
    lacks = any(light is None for light in shown)
    return None if lacks else [images[0] if light is None else light for light in found]


def earlier_of(scene: bpy.types.Scene, sequence: PlannedSequence) -> EarlierFrames | None:
    """Return what the frames of the panel's sequence have before them; None where no step asks, or it is not known."""
    lights = lights_of(scene, sequence) if sequence.setting.looks_back else None
    return None if lights is None else EarlierFrames(clean_stamps_s(scene), lambda source: lights[source])


def decided_at(scene: bpy.types.Scene, sequence: PlannedSequence) -> DecidedAt | None:
    """Return what automatics decide for a frame of the panel's sequence; None where it has none.

    Where frames were not metered, it is as if all had been mid-grey.
    """
    setting = sequence.setting
    if all(step.perturbation.decides is None for step in setting.rgb):
        return None
    stamps_s, earlier = clean_stamps_s(scene), earlier_of(scene, sequence)
    (_grey.add if setting.looks_back and earlier is None else _grey.discard)(scene.session_uid)
    light: Any = None if earlier is None else scene[KEPT]["light"]
    made_from = [setting, sequence.identifiers, sequence.source_frames, stamps_s.tolist(), light]
    known = _known.get(scene.session_uid)
    if known is None or known.made_from != made_from:
        known = _known[scene.session_uid] = _Known(made_from, {})
    clean = CleanFrames(Camera(None, stamps_s, earlier=GreyFrames() if earlier is None else earlier))
    by_frame, last = known.by_frame, len(sequence.source_frames) - 1

    def decided(frame: int) -> Mapping[str, FrameContext]:
        frame = min(max(frame, 0), last)
        if frame not in by_frame:
            by_frame[frame] = decided_by(Frame(sequence, frame, clean).colour)
        return by_frame[frame]

    return decided


def follows_grey(scene: bpy.types.Scene) -> bool:
    """Tell whether what a scene's preview decided last is as if all frames before had been mid-grey."""
    return scene.session_uid in _grey
