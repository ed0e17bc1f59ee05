# SPDX-License-Identifier: GPL-3.0-or-later
"""The sequences that an identity describes: their frames and rough cost, without the preset and without its files."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ..datasets.recorded_setting import RecordedSetting, RecordedStep
from ..errors import InputError
from ..perturbing.execution import split_motion
from ..perturbing.kinds import SEQUENCE_KINDS, ColourPerturbation, DepthPerturbation
from ..perturbing.reading import Registry, parse_steps
from ..perturbing.steps import Setting
from ..schema import ConfigPath
from .estimate import (
    SECONDS_PER_COMPOSITED_PIXEL,
    SECONDS_PER_PERTURBED_PIXEL,
    SECONDS_PER_PIXEL,
    rendering_seconds,
)
from .numbers import Numbers
from .sequence import lay_out

RENDERED = {"mesh", "blend"}  # inputs of scenes that a renderer takes; of others frames are read or computed
SECONDS_PER_LINK = 1e-4  # of an image that another sequence has already; measured, rounded


@dataclass(frozen=True)
class Described:
    """A sequence that an identity describes.

    frames: their numbers, of those that were asked for; None where a perturbation that decides them is not known here.
    seconds_each: what a frame costs by the estimate, on two cores; a render's cost is shared by those that show it.
    """

    setting: str
    scene: str
    frames: Numbers | None
    seconds_each: float

    @property
    def folder(self) -> str:
        """The sequence's folder inside the dataset, with forward slashes."""
        return f"{self.setting}/{self.scene}"


@dataclass(frozen=True)
class _Way:
    """How a setting makes its frames: what decides them, and the images that it perturbs."""

    known: Setting | None
    moves: bool
    perturbed: int
    composited: bool


def described_sequences(
    identity: Mapping[str, Any], registry: Registry, chosen: slice | None = None
) -> tuple[Described, ...]:
    """Return every sequence of an identity, in its order.

    identity: one that `read_dataset_state` has accepted. registry: the perturbations that there are. chosen: the frames
    of each sequence that are asked for, start and stop only.
    """
    ways = {name: _way(name, content, registry) for name, content in identity["settings"].items()}
    pairs = [folder.split("/") for folder in identity["sequences"]]
    shared = dict.fromkeys((scene for _, scene in pairs), 0)
    for setting, scene in pairs:
        shared[scene] += not ways[setting].moves
    found = []
    for setting, scene in pairs:
        way = ways[setting]
        frames = _frames(way, identity, scene, chosen)
        cost_s = _render_s(identity, scene) / (1 if way.moves else shared[scene]) + _images_s(identity, scene, way)
        found.append(Described(setting, scene, frames, cost_s))
    return tuple(found)


def _way(name: str, content: Mapping[str, Any], registry: Registry) -> _Way:
    recorded = RecordedSetting.read(content)
    kinds = [registry.get(step.name) for step in recorded.steps]
    deciding = [
        step
        for step, kind in zip(recorded.steps, kinds, strict=True)
        if kind is None or isinstance(kind, SEQUENCE_KINDS)
    ]
    perturbed = sum(any(isinstance(kind, image) for kind in kinds) for image in (ColourPerturbation, DepthPerturbation))
    composited = recorded.backend == "compositor" and any(isinstance(kind, ColourPerturbation) for kind in kinds)
    try:
        steps = parse_steps(list(_written(deciding)), ConfigPath(name, "steps"), registry)
    except InputError:  # of a package that is not installed here, or of a version with other parameters
        return _Way(None, False, perturbed, composited)
    setting = Setting(name, steps)
    moves = bool(setting.exposure or split_motion(setting.motion)[0])
    return _Way(setting, moves, perturbed, composited)


def _written(steps: Iterable[RecordedStep]) -> Iterator[dict[str, Any]]:
    """Yield steps of an identity as a preset would write them, with all their parameters."""
    for step in steps:
        severity = {} if step.severity is None else {"severity": step.severity}
        yield {step.name: {**severity, **(step.parameters[0] or {})}}


def _frames(way: _Way, identity: Mapping[str, Any], scene: str, chosen: slice | None) -> Numbers | None:
    if way.known is None:
        return None
    count = identity["scenes"][scene]["path"]["frames"]
    return lay_out(way.known, scene, count, (identity["seed"], scene, way.known.name), chosen).frames


def _pixels(identity: Mapping[str, Any], scene: str) -> int:
    camera = identity["scenes"][scene]["camera"]
    return camera["width"] * camera["height"]


def _render_s(identity: Mapping[str, Any], scene: str) -> float:
    """Estimate what rendering or reading a source frame takes, and writing it clean."""
    render = identity["render"]
    if render is None or not RENDERED & identity["scenes"][scene]["inputs"].keys():
        return _pixels(identity, scene) * SECONDS_PER_PIXEL
    return _pixels(identity, scene) * (rendering_seconds(render["engine"], render["samples"]) + SECONDS_PER_PIXEL)


def _images_s(identity: Mapping[str, Any], scene: str, way: _Way) -> float:
    per_pixel = way.perturbed * SECONDS_PER_PERTURBED_PIXEL + way.composited * SECONDS_PER_COMPOSITED_PIXEL
    return SECONDS_PER_LINK + _pixels(identity, scene) * per_pixel
