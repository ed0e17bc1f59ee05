# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading a preset's settings, sweeps and devices into steps, and checking them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from itertools import product
from math import prod
from typing import Any, TypeAlias, get_args, get_type_hints

from ..core.schema import ConfigPath, deciding_values, describe, parse, quoted, unknown_name
from ..preset.camera_devices import device_named
from ..preset.names import PLACEHOLDER, format_same_folder, safe_name, stream_name
from .kinds import SEQUENCE_KINDS, SEVERITIES, ColourPerturbation, DepthPerturbation, Perturbation, propagation_key
from .shares import COLOUR, MASK, MIX, has_colour, has_share, parse_share
from .steps import DEFAULT_SEVERITY, SENSOR_STREAM, Backend, Setting, Step, with_files

# `{device: NAME}` among a setting's steps stands for a real camera's shutter, lens and electronics.


DEVICE = "device"
NAME = "name"


def written_out(items: Sequence[Any], place: ConfigPath) -> Iterator[tuple[Any, ConfigPath]]:
    """Yield the entries of `perturb` with their places, a device's steps in its stead. Raises InputError.

    An entry that is a list stands for a device's file that has been read.
    """
    for index, item in enumerate(items):
        where = place.at(index)
        if isinstance(item, list):
            yield from ((step, where) for step in item)
            continue
        if isinstance(item, Mapping) and list(item) == [DEVICE]:
            for step in _steps(item[DEVICE], where.at(DEVICE)):
                yield step, where
        else:
            yield item, where


def _steps(value: object, place: ConfigPath) -> Iterator[dict[str, Any]]:
    """Yield the steps of {name: a device, a step's name: parameters in place of the device's, or false}."""
    given = value if isinstance(value, Mapping) else {NAME: value}
    if NAME not in given:
        raise place.error("names no device", "write {device: {name: phone}}")
    device = device_named(given[NAME], place.at(NAME) if value is given else place)
    for name, other in given.items():
        if name == NAME:
            continue
        if name not in device.steps:
            raise unknown_name(place.at(str(name)), f"part of a {device.label}", str(name), list(device.steps))
        if other is not False and not isinstance(other, Mapping):
            problem = f"is {describe(other)}, but has to be a mapping of parameters, or false"
            raise place.at(str(name)).error(problem, "false leaves it out")
    for name, values in device.steps.items():
        own = given.get(name, {})
        if isinstance(own, Mapping):
            yield {name: {**values, **own}}


# Sweeps: settings of one perturbation each, for every severity, mode and value of its parameters.


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


LARGEST_SETTINGS = 10_000  # chosen: a hundred times the paper's


def parse_settings(
    items: Sequence[Any], places: Sequence[ConfigPath], registry: Registry, backend: Backend = "reference"
) -> tuple[Setting, ...]:
    """Read the preset's settings: SettingSpec items with `name` and `perturb`, or with `sweep`.

    places: of each item. backend: for settings that name none.

    Raises InputError naming the key.
    """
    _check_count(items, places)
    found: list[tuple[Setting, ConfigPath]] = []
    for item, where in zip(items, places, strict=True):
        if (item.name is None) == (item.sweep is None):
            raise where.error("needs either name or sweep", "name the setting, or sweep over several")
        if item.sweep is not None:
            for key in ("perturb", "stream"):
                if getattr(item, key):
                    remedy = "write it into the sweep" if key == "stream" else ""
                    raise where.at(key).error("goes with name, not with sweep", remedy)
            at_stream = where.at("sweep").at("stream")
            for name, stream, step, inside in swept(item.sweep, where.at("sweep"), registry):
                steps = drawing_by(parse_steps([step], inside, registry), name, stream, at_stream)
                found.append((Setting(name, steps, item.backend or backend, deciding_values(item)), where))
        else:
            steps = parse_steps(item.perturb, where.at("perturb"), registry)
            steps = drawing_by(steps, item.name, item.stream, where.at("stream"))
            found.append((Setting(item.name, steps, item.backend or backend, deciding_values(item)), where.at("name")))
    names: dict[str, str] = {}
    for setting, where in found:
        if (other := names.get(setting.name.casefold())) is not None:
            same = other == setting.name
            problem = f"{other!r} is given twice" if same else format_same_folder(setting.name, other)
            raise where.error(problem, "give one another name")
        names[setting.name.casefold()] = setting.name
    return tuple(setting for setting, _ in found)


def drawing_by(steps: tuple[Step[Any], ...], name: str, stream: str | None, place: ConfigPath) -> tuple[Step[Any], ...]:
    """Return a setting's steps with the name under which those of colour and depth draw their random patterns.

    name: the setting's, which is what they draw by without a stream. Raises InputError where nothing is drawn by it.
    """
    if stream is None or stream == name:
        return steps
    if all(isinstance(step.perturbation, SEQUENCE_KINDS) for step in steps):
        names = ", ".join(step.perturbation.name for step in steps) or "a clean setting"
        raise place.error(f"goes with perturbations of colour and depth, not with {names}", "leave it out")
    return tuple(
        step if isinstance(step.perturbation, SEQUENCE_KINDS) else replace(step, stream=stream) for step in steps
    )


def _check_count(items: Sequence[Any], places: Sequence[ConfigPath]) -> None:
    count = 0
    for item, place in zip(items, places, strict=True):
        count += 1 if item.sweep is None else sweep_size(item.sweep, place.at("sweep"))
        if count > LARGEST_SETTINGS:
            problem = f"makes {count} settings with those before it; at most {LARGEST_SETTINGS} are made"
            raise place.error(problem)


def parse_steps(items: Sequence[Any], place: ConfigPath, registry: Registry) -> tuple[Step[Any], ...]:
    """Read a list of `{name: {severity, mode, levels, temporal, mix, mask, parameters...}}` into steps.

    They are in propagation order. `{device: NAME}` stands for a real camera's.
    """
    steps: list[Step[Any]] = []
    for item, where in written_out(items, place):
        name, values = _named(item, where, "{fog: {severity: 3}}")
        perturbation = known_perturbation(name, where, registry)
        same = sum(step.perturbation.name == name for step in steps)
        if same and isinstance(perturbation, SEQUENCE_KINDS):
            raise where.error(f"{name} is given twice", "it acts once on a sequence")
        if same and isinstance(perturbation, ColourPerturbation) and perturbation.automatic is not None:
            raise where.error(f"{name} is given twice", "a camera has one of it")
        if is_sensor(perturbation) and (first := next(filter(is_sensor, (step.perturbation for step in steps)), None)):
            raise where.error(f"{name} measures depth, which {first.name} has measured", "keep one of them")
        steps.append(_parse_step(perturbation, values, where.at(str(name)), same))
    return tuple(sorted(steps, key=lambda step: propagation_key(step.perturbation)))


def parse_sensor(value: object, place: ConfigPath, registry: Registry) -> Step[DepthPerturbation]:
    """Read a rig's depth sensor: the name of a device, or one perturbation of depth as in a setting.

    It draws the same patterns in every setting, so that settings which leave depth alone share its images.
    """
    if isinstance(value, str):
        devices = _devices(registry)
        if isinstance(registry.get(value), DepthPerturbation):
            raise place.error(f"{value} is a model of sensors, and a device is named so", f"write {{{value}: {{}}}}")
        if value not in devices:
            raise unknown_name(place, "depth sensor", value, list(devices))
        value = {devices[value]: {"device": value}}
    name, values = _named(value, place, "a device, or {stereo: {noise: 0.5}}")
    perturbation = known_perturbation(name, place, registry)
    if not isinstance(perturbation, DepthPerturbation):
        raise place.error(f"{name} does not act on depth", "name a device, or a perturbation of depth")
    return replace(_parse_step(perturbation, values, place.at(name), 0), stream=SENSOR_STREAM)


def check_device_part(part: str, value: Any, place: ConfigPath, registry: Registry) -> None:
    """Refuse what a measured device's file says wrongly. part: depth or perturb. place: in the file."""
    if part == "depth":
        if isinstance(value, str):
            raise place.error(f"is {describe(value)}, but has to be a perturbation of depth", "write {axial_noise: {}}")
        parse_sensor(value, place, registry)
    else:
        parse_steps(value, place, registry)


def is_sensor(perturbation: Perturbation) -> bool:
    """Tell whether a perturbation is a depth sensor: it has a table of devices."""
    return isinstance(perturbation, DepthPerturbation) and "device" in get_type_hints(perturbation.parameters)


def _devices(registry: Registry) -> dict[str, str]:
    """Return by each device that a perturbation of depth has a table of the name of that perturbation."""
    found: dict[str, str] = {}
    for item in registry.values():
        if is_sensor(item):
            device = get_type_hints(item.parameters)["device"]
            found |= {name: item.name for name in get_args(device) if name not in found}
    return found


def _named(item: object, place: ConfigPath, example: str) -> tuple[str, object]:
    if not isinstance(item, Mapping) or len(item) != 1:
        raise place.error(f"is {describe(item)}, but has to be one name with its values", f"write {example}")
    ((name, values),) = item.items()
    return str(name), values


def _parse_step(perturbation: Perturbation, values: object, place: ConfigPath, same: int) -> Step[Any]:
    values = {} if values is None else values
    if not isinstance(values, Mapping):
        raise place.error(f"is {describe(values)}, but has to be a mapping", "write {severity: 3}, for instance")
    known = [item.name for item in fields(perturbation.parameters)]
    own = ["severity", "mode", "levels"] if perturbation.severities else []
    own += ["temporal"] if perturbation.temporals else []
    of_share = [MIX, MASK] if has_share(perturbation) else []
    of_share += [COLOUR] if has_colour(perturbation) else []
    own += of_share
    for name in values:
        if name not in (*own, *known):
            raise unknown_name(place.at(str(name)), "key", str(name), [*own, *known])
    inside = {name: value for name, value in values.items() if name in known}
    parsed = parse(perturbation.parameters, inside, place)
    given = with_files(perturbation.parameters, {name: getattr(parsed, name) for name in inside}, place)
    severity, levels = (
        _parse_severity(values, place, by_parameters=bool(given)) if own[:1] == ["severity"] else (None, None)
    )
    mode = values.get("mode", "static")
    if levels is not None and isinstance(perturbation, SEQUENCE_KINDS):
        raise place.at("mode").error(
            f"is {mode}, but it acts on the whole sequence at one severity", "give severity alone"
        )
    temporal = values.get("temporal", perturbation.temporals[0] if perturbation.temporals else "fresh")
    if perturbation.temporals and temporal not in perturbation.temporals:
        choices = ", ".join(perturbation.temporals)
        raise place.at("temporal").error(f"is {describe(temporal)}, but has to be one of {choices}")
    keyed = levels is not None and mode == "keyed"
    share = parse_share({name: values.get(name) for name in of_share}, place)
    step = Step(perturbation, same, severity, levels, temporal, given, keyed=keyed, share=share)
    _check_values(step, place)
    return step


def _check_values(step: Step[Any], place: ConfigPath) -> None:
    if (contradiction := step.perturbation.contradiction) is None:
        return
    for severity in (step.severity,) if step.levels is None else step.levels:
        if severity != 0 and (problem := contradiction(step.parameters(severity))):
            raise place.error(problem, "change one of them")


def _parse_severity(
    values: Mapping[str, Any], place: ConfigPath, *, by_parameters: bool
) -> tuple[float | None, tuple[float, ...] | None]:
    mode = values.get("mode", "static")
    if mode not in ("static", "dynamic", "keyed"):
        raise place.at("mode").error(f"is {describe(mode)}, but has to be static, dynamic or keyed")
    if mode == "keyed" and "levels" not in values:
        raise place.at("mode").error("is keyed, which goes with levels", "list the severity of each frame there")
    default = None if by_parameters and mode == "static" else DEFAULT_SEVERITY
    severity = _level(values["severity"], place.at("severity")) if "severity" in values else default
    if mode == "static":
        if "levels" in values:
            raise place.at("levels").error("goes with mode: dynamic or keyed", "set the mode, or severity instead")
        return severity, None
    if "levels" in values:
        if "severity" in values:
            raise place.at("levels").error("stands beside severity", "keep one of them")
        levels = values["levels"]
        if not isinstance(levels, Sequence) or isinstance(levels, (str, bytes)) or not levels:
            raise place.at("levels").error(
                f"is {describe(levels)}, but has to be a list of severities", "put them in [ ]"
            )
        return None, tuple(_level(value, place.at("levels").at(k)) for k, value in enumerate(levels))
    assert severity is not None
    if severity != round(severity):
        raise place.at("severity").error(
            f"is {severity:g}, but dynamic mode draws from 0 to a whole one", "or give levels"
        )
    return severity, tuple(float(k) for k in range(int(severity) + 1))


def _level(value: object, place: ConfigPath) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise place.error(f"is {describe(value)}, but has to be a severity", "allowed: 0, or 1 to 5")
    if value != 0 and not SEVERITIES[0] <= value <= SEVERITIES[-1]:
        raise place.error(f"is {quoted(value)}, out of range", "allowed: 0, or 1 to 5")
    return float(value)
