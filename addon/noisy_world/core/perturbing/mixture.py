# SPDX-License-Identifier: GPL-3.0-or-later
"""What a setting does to a sequence: its perturbations in propagation order, read from a preset, and carried out.

The order is the paper's, whatever the order in the preset: motion, then colour (environment, lens, sensor,
post-processing) and depth, then synchronisation; within a stage by name.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import product
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..datasets.images import rgb_bytes
from ..schema import Place, describe, parse, unknown_name
from ..trajectories.trajectory import Trajectory
from .kinds import CATEGORIES, RGB_CATEGORIES, SEVERITIES, Frame, Perturbation, Temporal

type Registry = Mapping[str, Perturbation]
type Identifiers = tuple[str | int, ...]
"""What names the streams of a sequence: the preset's seed, the scene, the setting."""

type Backend = Literal["compositor", "reference"]

DEFAULT_SEVERITY = 3.0
ONCE_ONLY = ("motion", "sync")  # categories of which each perturbation acts once on a sequence


@dataclass(frozen=True)
class Step:
    """One perturbation of a mixture.

    place: its place among those of the same name. severity: None where parameters alone are given. levels: what each
    frame's severity is drawn from, in dynamic mode. given: parameters that stand over the severity's.
    """

    perturbation: Perturbation
    place: int
    severity: float | None
    levels: tuple[float, ...] | None
    temporal: Temporal
    given: Mapping[str, Any]

    def frame(self, index: int, identifiers: Identifiers) -> Frame:
        """Return a frame of the sequence as this step's streams see it."""
        return Frame(index, (*identifiers, self.perturbation.name, self.place), self.temporal)

    def severity_of(self, frame: Frame) -> float | None:
        """Return the severity of a frame, drawn for it in dynamic mode (decisions: i.i.d. uniform)."""
        if self.levels is None:
            return self.severity
        return self.levels[int(frame.stream("severity").integers(len(self.levels)))]

    def parameters(self, severity: float | None) -> Any:
        """Return the parameters of a severity."""
        if severity is None:
            return self.perturbation.parameters(**self.given)
        return self.perturbation.at_severity(severity, **self.given)

    def note(self, frame: Frame, severity: float | None) -> dict[str, Any]:
        """Say for the provenance what is done to a frame."""
        done: dict[str, Any] = {"name": self.perturbation.name, "stream": list(frame.identifiers)}
        if severity is not None:
            done["severity"] = severity
        if severity != 0:
            done["parameters"] = asdict(self.parameters(severity))
        return done


@dataclass(frozen=True)
class Setting:
    """A setting of the benchmark: a name and what is done to every scene, in propagation order. None is clean.

    backend: what executes the steps of colour.
    """

    name: str
    steps: tuple[Step, ...] = ()
    backend: Backend = "reference"

    @property
    def rgb(self) -> tuple[Step, ...]:
        """What is done to colour."""
        return tuple(step for step in self.steps if step.perturbation.category in RGB_CATEGORIES)

    @property
    def composited(self) -> bool:
        """Whether Blender's compositor has something to do."""
        return self.backend == "compositor" and bool(self.rgb)

    @property
    def needs_depth(self) -> bool:
        """Whether something is done to colour that depends on depth."""
        return any(step.perturbation.needs_depth for step in self.rgb)

    @property
    def depth(self) -> tuple[Step, ...]:
        """What is done to depth."""
        return tuple(step for step in self.steps if step.perturbation.category == "depth")

    def named(self, name: str) -> Step | None:
        """Return the step of a name, where there is one."""
        return next((step for step in self.steps if step.perturbation.name == name), None)


# --- carrying out ---


def perturb_rgb(
    steps: Sequence[Step],
    rgb: NDArray[Any],
    index: int,
    identifiers: Identifiers,
    depth_m: NDArray[np.float32] | None = None,
) -> tuple[NDArray[np.uint8] | None, list[dict[str, Any]]]:
    """Perturb a colour image and round it once, at the end.

    rgb: (H, W, 3) sRGB-encoded RGB, float32 in [0, 1] or uint8. Between the steps values are float, clipped to [0, 1].
    depth_m: (H, W) planar depth in metres, for steps that ask for it.
    Returns (H, W, 3) uint8, or None where every severity is 0, which is the identity; and what was done.
    """
    drawn = [(step, step.frame(index, identifiers)) for step in steps]
    done = [(step, frame, step.severity_of(frame)) for step, frame in drawn]
    notes = [step.note(frame, severity) for step, frame, severity in done]
    active = [(step, frame, severity) for step, frame, severity in done if severity != 0]
    if not active:
        return None, notes
    if len(active) == 1 and rgb.dtype == np.uint8 and active[0][0].perturbation.apply_bytes is not None:
        step, frame, severity = active[0]
        return step.perturbation.apply_bytes(rgb, step.parameters(severity), frame), notes
    image = rgb / np.float32(255) if rgb.dtype == np.uint8 else rgb
    for step, frame, severity in active:
        image = perturb_colour(step, image, severity, frame, depth_m)
        np.clip(image, 0.0, 1.0, out=image)
    return rgb_bytes(image), notes


def perturb_colour(
    step: Step,
    rgb: NDArray[np.float32],
    severity: float | None,
    frame: Frame,
    depth_m: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Carry out one step on (H, W, 3) float32; what comes back may lie outside [0, 1]."""
    if not step.perturbation.needs_depth:
        return _executed(step)(rgb, step.parameters(severity), frame)
    if depth_m is None:
        raise TypeError(f"{step.perturbation.name} needs the frame's depth")
    return _executed(step)(rgb, step.parameters(severity), frame, depth_m)


def perturb_depth(
    steps: Sequence[Step], depth_m: NDArray[np.float32], index: int, identifiers: Identifiers
) -> tuple[NDArray[np.float32] | None, list[dict[str, Any]]]:
    """Perturb planar depth (H, W) in metres, 0 = void. Returns None where every severity is 0; and what was done."""
    image, notes = None, []
    for step in steps:
        frame = step.frame(index, identifiers)
        severity = step.severity_of(frame)
        notes.append(step.note(frame, severity))
        if severity != 0:
            image = _executed(step)(depth_m if image is None else image, step.parameters(severity), frame)
    return image, notes


def perturb_motion(step: Step, trajectory: Trajectory, identifiers: Identifiers) -> Trajectory:
    """Perturb a trajectory."""
    return _executed(step)(trajectory, step.parameters(None), step.frame(0, identifiers))


def paired_depth(step: Step, count: int, identifiers: Identifiers) -> list[int]:
    """Return for each of `count` frames the frame whose depth goes with it; -1 where the frame is left out."""
    return [int(k) for k in _executed(step)(count, step.parameters(None), step.frame(0, identifiers))]


def _executed(step: Step) -> Any:
    assert step.perturbation.apply is not None, f"{step.perturbation.name} has no execution"
    return step.perturbation.apply


# --- reading ---


def parse_settings(
    items: Sequence[Any], place: Place, registry: Registry, backend: Backend = "reference"
) -> tuple[Setting, ...]:
    """Read the preset's settings: SettingSpec items with `name` and `perturb`, or with `sweep`.

    backend: of the settings that name none.

    Raises InputError naming the key.
    """
    found: list[tuple[Setting, Place]] = []
    for index, item in enumerate(items):
        where = place.at(index)
        if (item.name is None) == (item.sweep is None):
            raise where.error("needs either name or sweep", "name the setting, or sweep over several")
        if item.sweep is not None:
            if item.perturb:
                raise where.at("perturb").error("goes with name, not with sweep")
            swept = _swept(item.sweep, where.at("sweep"), registry, item.backend or backend)
            found += [(setting, where) for setting in swept]
        else:
            steps = parse_steps(item.perturb, where.at("perturb"), registry)
            found.append((Setting(item.name, steps, item.backend or backend), where.at("name")))
    names: set[str] = set()
    for setting, where in found:
        if setting.name in names:
            raise where.error(f"{setting.name!r} is given twice")
        names.add(setting.name)
    return tuple(setting for setting, _ in found)


def _swept(sweep: Any, place: Place, registry: Registry, backend: Backend) -> list[Setting]:
    """Make a setting of each name, severity and mode: `fog_s3`, `fog_s3_dynamic`."""
    settings = []
    for (index, name), severity, mode in product(enumerate(sweep.perturb), sweep.severities, sweep.modes):
        where = place.at("perturb").at(index)
        if _known(name, where, registry).severities == {}:
            raise where.error(f"{name} has no severities to sweep over", "write a setting for each of its parameters")
        steps = parse_steps([{name: {"severity": severity, "mode": mode}}], where, registry)
        suffix = "_dynamic" if mode == "dynamic" else ""
        settings.append(Setting(f"{name}_s{severity:g}{suffix}", steps, backend))
    return settings


def parse_steps(items: Sequence[Any], place: Place, registry: Registry) -> tuple[Step, ...]:
    """Read a list of `{name: {severity, mode, levels, temporal, parameters...}}` into steps in propagation order."""
    steps: list[Step] = []
    for index, item in enumerate(items):
        where = place.at(index)
        if not isinstance(item, Mapping) or len(item) != 1:
            raise where.error(
                f"is {describe(item)}, but has to be one name with its values", "write {fog: {severity: 3}}"
            )
        ((name, values),) = item.items()
        perturbation = _known(name, where, registry)
        same = sum(step.perturbation.name == name for step in steps)
        if same and perturbation.category in ONCE_ONLY:
            raise where.error(f"{name} is given twice", "it acts once on a sequence")
        steps.append(_parse_step(perturbation, values, where.at(str(name)), same))
    return tuple(sorted(steps, key=lambda step: (CATEGORIES.index(step.perturbation.category), step.perturbation.name)))


def _known(name: object, place: Place, registry: Registry) -> Perturbation:
    if name not in registry:
        raise unknown_name(place, "perturbation", str(name), list(registry))
    return registry[str(name)]


def _parse_step(perturbation: Perturbation, values: object, place: Place, same: int) -> Step:
    values = {} if values is None else values
    if not isinstance(values, Mapping):
        raise place.error(f"is {describe(values)}, but has to be a mapping", "write {severity: 3}, for instance")
    known = [item.name for item in fields(perturbation.parameters)]
    own = ["severity", "mode", "levels"] if perturbation.severities else []
    own += ["temporal"] if perturbation.temporals else []
    for name in values:
        if name not in (*own, *known):
            raise unknown_name(place.at(str(name)), "key", str(name), [*own, *known])
    inside = {name: value for name, value in values.items() if name in known}
    parsed = parse(perturbation.parameters, inside, place)
    given = {name: getattr(parsed, name) for name in inside}
    severity, levels = (
        _parse_severity(values, place, by_parameters=bool(given)) if own[:1] == ["severity"] else (None, None)
    )
    temporal = values.get("temporal", perturbation.temporals[0] if perturbation.temporals else "fresh")
    if perturbation.temporals and temporal not in perturbation.temporals:
        choices = ", ".join(perturbation.temporals)
        raise place.at("temporal").error(f"is {describe(temporal)}, but has to be one of {choices}")
    return Step(perturbation, same, severity, levels, temporal, given)


def _parse_severity(
    values: Mapping[str, Any], place: Place, *, by_parameters: bool
) -> tuple[float | None, tuple[float, ...] | None]:
    mode = values.get("mode", "static")
    if mode not in ("static", "dynamic"):
        raise place.at("mode").error(f"is {describe(mode)}, but has to be static or dynamic")
    default = None if by_parameters and mode == "static" else DEFAULT_SEVERITY
    severity = _level(values["severity"], place.at("severity")) if "severity" in values else default
    if mode == "static":
        if "levels" in values:
            raise place.at("levels").error("goes with mode: dynamic", "set the mode, or severity instead")
        return severity, None
    if "levels" in values:
        if "severity" in values:
            raise place.at("levels").error("stands beside severity", "keep one of them")
        levels = values["levels"]
        if not isinstance(levels, Sequence) or isinstance(levels, str) or not levels:
            raise place.at("levels").error(f"is {describe(levels)}, but has to be a list of severities")
        return None, tuple(_level(value, place.at("levels").at(k)) for k, value in enumerate(levels))
    assert severity is not None
    if severity != round(severity):
        raise place.at("severity").error(
            f"is {severity:g}, but dynamic mode draws from 0 to a whole one", "or give levels"
        )
    return severity, tuple(float(k) for k in range(int(severity) + 1))


def _level(value: object, place: Place) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise place.error(f"is {describe(value)}, but has to be a severity")
    if value != 0 and not SEVERITIES[0] <= value <= SEVERITIES[-1]:
        raise place.error(f"is {value:g}, out of range", "allowed: 0, or 1 to 5")
    return float(value)
