# SPDX-License-Identifier: GPL-3.0-or-later
"""Sweeps: settings of one perturbation each, for every severity, mode and value of its parameters."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from itertools import product
from math import prod
from typing import Any, TypeAlias

from ..presets.names import PLACEHOLDER, safe_name, stream_name
from ..schema import ConfigPath, describe, unknown_name
from .kinds import Perturbation

Registry: TypeAlias = Mapping[str, Perturbation]

SEVERITIES_SWEPT = (1.0, 2.0, 3.0, 4.0, 5.0)  # where a sweep names none


def known_perturbation(name: object, place: ConfigPath, registry: Registry) -> Perturbation:
    """Return the perturbation of a name. Raises InputError."""
    if name not in registry:
        raise unknown_name(place, "perturbation", str(name), list(registry))
    return registry[str(name)]


def sweep_size(sweep: Any, place: ConfigPath) -> int:
    """Return how many settings a SweepSpec makes, before any is left out. Raises InputError."""
    values = _parameters(sweep.parameters, place.at("parameters"))
    severities = _severities(sweep)
    axes = (sweep.perturb, severities or (None,), sweep.modes or (None,), *values.values())
    return prod(len(axis) for axis in axes)


def swept(
    sweep: Any, place: ConfigPath, registry: Registry
) -> Iterator[tuple[str, str | None, dict[str, Any], ConfigPath]]:
    """Yield each setting of a SweepSpec: its name, its stream, its step as a preset has it, and the place of that.

    The order is that of the lists, the last one varying first. Raises InputError.
    """
    for axis in ("perturb", "severities", "modes"):
        if getattr(sweep, axis) == ():
            raise place.at(axis).error("is empty", "name one")
    parameters = _parameters(sweep.parameters, place.at("parameters"))
    excluded = _excluded(sweep, place.at("without"), parameters)
    unused = {id(item) for item in excluded}
    for index, name in enumerate(sweep.perturb):
        where = place.at("perturb").at(index)
        _check_axes(sweep, known_perturbation(name, where, registry), parameters, place, where)
    if parameters and sweep.name is None:
        example = "_".join(("{perturb}", *(f"{{{name}}}" for name in parameters)))
        raise place.at("name").error("is missing", f"say what each setting is called, {example!r} for instance")
    for index, name in enumerate(sweep.perturb):
        where = place.at("perturb").at(index)
        for severity, mode, *values in product(
            _severities(sweep) or (None,), sweep.modes or (None,), *parameters.values()
        ):
            given = dict(zip(parameters, values, strict=True))
            chosen = {
                key: value for key, value in (("severity", severity), ("mode", mode)) if value is not None
            } | given
            parts = {"perturb": name, "mode": mode or "static", **chosen}
            matching = [item for item in excluded if all(parts.get(key) == value for key, value in item.items())]
            unused -= {id(item) for item in matching}
            if not matching:
                yield _name(sweep.name, parts, place.at("name")), _stream(sweep, parts, place), {name: chosen}, where
    if unused:
        index = next(k for k, item in enumerate(excluded) if id(item) in unused)
        raise place.at("without").at(index).error("leaves nothing out", "take it out, or mend its values")


def _severities(sweep: Any) -> tuple[float, ...]:
    """Return the severities to sweep over; none where parameters are swept instead."""
    if sweep.severities is not None:
        return sweep.severities
    return () if sweep.parameters else SEVERITIES_SWEPT


def _check_axes(
    sweep: Any, perturbation: Perturbation, parameters: Mapping[str, Any], place: ConfigPath, where: ConfigPath
) -> None:
    """Refuse a sweep over what a perturbation does not have."""
    name = perturbation.name
    own = [item.name for item in fields(perturbation.parameters)]
    if _severities(sweep) and not perturbation.severities:
        example = f"parameters: {{{own[0]}: [...]}}"
        raise where.error(f"{name} has no severities to sweep over", f"sweep over its parameters, {example}")
    if sweep.modes is not None and not perturbation.severities and "mode" not in own:
        raise place.at("modes").error(f"{name} has no modes", "leave them out")
    for parameter in parameters:
        if parameter not in own:
            raise unknown_name(place.at("parameters").at(parameter), f"parameter of {name}", parameter, own)


def _parameters(given: object, place: ConfigPath) -> dict[str, Sequence[Any]]:
    """Return the lists of values by the name of the parameter."""
    if given is None:
        return {}
    if not isinstance(given, Mapping) or not given:
        raise place.error(f"is {describe(given)}, but has to be a mapping of lists", "write {factor: [2, 4, 8]}")
    for name, values in given.items():
        if isinstance(values, (str, bytes)) or not isinstance(values, Sequence) or not values:
            raise place.at(str(name)).error(f"is {describe(values)}, but has to be a list of values", "put it in [ ]")
    return {str(name): values for name, values in given.items()}


def _excluded(sweep: Any, place: ConfigPath, parameters: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the combinations that are left out."""
    items = sweep.without
    if items is None:
        return []
    if isinstance(items, (str, bytes)) or not isinstance(items, Sequence):
        raise place.error(f"is {describe(items)}, but has to be a list", "write [{rotation_deg: 0, translation_m: 0}]")
    known = ["perturb", "severity", "mode", *parameters]
    for index, item in enumerate(items):
        if not isinstance(item, Mapping) or not item:
            raise place.at(index).error(f"is {describe(item)}, but has to be a mapping of values")
        for name in item:
            if name not in known:
                raise unknown_name(place.at(index), "key", str(name), known)
    return [dict(item) for item in items]


def _name(template: str | None, parts: Mapping[str, Any], place: ConfigPath) -> str:
    """Return a setting's name. parts: what the template may name."""
    if template is None:
        suffix = "_dynamic" if parts["mode"] == "dynamic" else ""
        return f"{parts['perturb']}_s{parts['severity']:g}{suffix}"
    name = _filled(template, parts, place)
    if problem := safe_name(name):
        raise place.error(problem)
    return name


def _stream(sweep: Any, parts: Mapping[str, Any], place: ConfigPath) -> str | None:
    """Return the name of a setting's stream, None where it is the setting's own."""
    if sweep.stream is None:
        return None
    stream = _filled(sweep.stream, parts, place.at("stream"))
    if problem := stream_name(stream):
        raise place.at("stream").error(problem)
    return stream


def _filled(template: str, parts: Mapping[str, Any], place: ConfigPath) -> str:
    for name in PLACEHOLDER.findall(template):
        if name not in parts:
            raise unknown_name(place, "placeholder", name, list(parts))
    return PLACEHOLDER.sub(lambda found: _text(parts[found[1]]), template)


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)
