# SPDX-License-Identifier: GPL-3.0-or-later
"""A preset as Blender properties: a group for each dataclass, how it is drawn, the document that it makes.

A preset as Blender properties: a group for each of its dataclasses, and the document that they say.

Beside each value a tick `use_NAME` says whether the preset gives it; a change by hand sets it. What is neither number,
text, choice, switch nor list of choices is a line of YAML, so there is nothing in a preset that cannot be held.
"""

import json
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import bpy
import numpy as np

from ..core.errors import InputError
from ..core.lens import MODELS
from ..core.schema import KeyInfo, label_of, read_yaml
from ..perturbations import registry
from ..perturbations.kinds import MotionPerturbation
from ..preset.keys import ImuSpec
from ..preset.sensor_keys import OF_ANGLE
from .fields import (
    LARGEST_INT,
    SECTIONS,
    SHOWN,
    ShownField,
    described,
    notify_once,
    plain_hint,
    section_of,
    sentence,
    tell,
)
from .words import FILES, words_of

GIVEN = "use_"
EXACT = "exact"
GROUPS: list[type] = []
"""The classes of all groups, in the order of registration."""

HOOKS: dict[tuple[type, str], Callable[[Any], None]] = {}
"""What follows from a change by hand of a field; called with the group that holds it."""

_made: dict[tuple[type, str], type] = {}
_taking: list[bool] = []

FileText = Callable[[str], str]
"""Gives the file that a text names as the other side has it."""


# --- groups ---


def group_of(cls: type, *, leave: Collection[str] = (), name: str = "", section: str = "") -> type:
    """Return the property group of a dataclass. leave: fields that are held elsewhere. name: of the class."""
    known = (cls, name)
    if known not in _made:
        members: dict[str, Any] = {EXACT: bpy.props.StringProperty(options={"HIDDEN"})}
        for item in fields(cls):
            if item.name not in leave:
                members |= members_of(cls, item.name, section=section)
        _made[known] = make_group(name or f"NoisyWorld{cls.__name__}Group", members)
    return _made[known]


def make_group(name: str, members: dict[str, Any]) -> type:
    """Make a property group, which is registered after those made before it."""
    made = type(name, (bpy.types.PropertyGroup,), {"__annotations__": members, "__module__": __name__})
    GROUPS.append(made)
    return made


def members_of(cls: type, name: str, *, section: str = "", **more: Any) -> dict[str, Any]:
    """Return the property of a field and its tick. more: arguments of the property."""
    item, inside, words = field_of(cls, name), inside_of(cls, name), words_of(cls, name)
    info: KeyInfo = item.metadata["key"]
    ticked = words.pop("given", item.default is MISSING and item.default_factory is MISSING)
    label = words.get("label") or label_of(cls, name)
    if inside is not None:
        group = group_of(inside, section="" if inside in SECTIONS else section)
        made: Any = bpy.props.PointerProperty(type=group, name=label)
        SHOWN[cls, name] = ShownField(SECTIONS.get(inside) or f"{section or section_of(cls)} > {label}", {})
    elif _is_widget(cls, name):
        files: dict[str, Any] = (
            {"subtype": FILES[cls, name], "options": {"PATH_SUPPORTS_BLEND_RELATIVE"}} if (cls, name) in FILES else {}
        )
        given = {"section": section, "update": on_change(name, cls), **files, **words, **more}
        made = described(cls, name, **given)
    else:
        text = f"{sentence(info.meaning)}; as YAML"
        SHOWN[cls, name] = ShownField(f"{section or section_of(cls)} > {label}", {})
        made = bpy.props.StringProperty(options=set(), name=label, description=text, update=on_change(name, cls))
    tick = bpy.props.BoolProperty(
        options=set(), default=ticked, name=label, description=sentence(info.meaning), update=_on_tick(name)
    )
    return {property_name(name): made, GIVEN + name: tick}


@cache
def field_of(cls: type, name: str) -> Field[Any]:
    """Return a dataclass's field."""
    return next(item for item in fields(cls) if item.name == name)


@cache
def hint_of(cls: type, name: str) -> Any:
    """Return the type of a field's values, but None."""
    return plain_hint(get_type_hints(cls)[name])


@cache
def inside_of(cls: type, name: str) -> type | None:
    """Return the dataclass that a field holds; None where it holds none."""
    hint = hint_of(cls, name)
    return hint if isinstance(hint, type) and is_dataclass(hint) else None


@cache
def is_line(cls: type, name: str) -> bool:
    """Tell whether a field is held as a line of YAML."""
    return inside_of(cls, name) is None and not _is_widget(cls, name)


@cache
def _is_widget(cls: type, name: str) -> bool:
    hint, info = hint_of(cls, name), field_of(cls, name).metadata["key"]
    if hint in (int, float, bool, str) or get_origin(hint) is Literal:
        return True
    entries = set(get_args(hint))
    return get_origin(hint) is tuple and (entries == {float} or (entries == {str, Ellipsis} and bool(info.choices)))


# --- changes ---


def tell_of(name: str) -> Callable[[Any, bpy.types.Context], None]:
    """Return an update function that tells the listeners of a property by its path from the panel, as "camera.fx".

    Of an entry of the list they hear "motion" where it moves the camera, else "steps".
    """

    def update(group: Any, context: bpy.types.Context) -> None:
        inside = group.path_from_id().partition(".")[2]
        if inside.startswith("steps["):
            moves = isinstance(registry().get(inside.rpartition(".")[2]), MotionPerturbation)
            tell("motion" if moves else "steps")(group, context)
        else:
            tell(f"{inside}.{name}" if inside else name)(group, context)

    return update


def on_change(name: str, cls: type | None = None) -> Callable[[Any, bpy.types.Context], None]:
    """Return an update function: what is changed by hand is given from then on, and the listeners are told."""
    told = tell_of(name)

    def update(group: Any, context: bpy.types.Context) -> None:
        with notify_once():
            if not _taking:
                give(group, name)
                if cls is not None and (cls, name) in HOOKS:
                    HOOKS[cls, name](group)
            told(group, context)

    return update


def _on_tick(name: str) -> Callable[[Any, bpy.types.Context], None]:
    told = tell_of(GIVEN + name)

    def update(group: Any, context: bpy.types.Context) -> None:
        with notify_once():
            if not _taking:
                (give if is_given(group, name) else _leave_empty)(group, name)
            told(group, context)

    return update


def _leave_empty(group: Any, _: str) -> None:
    """Untick the group of a value that is not given any more, where that was its last one."""
    before, _, last = group.path_from_id().rpartition(".")
    ticks = [item.identifier for item in group.bl_rna.properties if item.identifier.startswith(GIVEN)]
    if before and not last.endswith("]") and not any(getattr(group, tick) for tick in ticks):
        owner = group.id_data.path_resolve(before)
        if hasattr(owner, GIVEN + last):
            setattr(owner, GIVEN + last, False)


def give(group: Any, name: str) -> None:
    """Tick a value, and the groups that it is in."""
    _tick(group, name)
    before, _, last = group.path_from_id().rpartition(".")
    while before and not before.endswith("]") and not last.endswith("]"):
        _tick(group.id_data.path_resolve(before), last)
        before, _, last = before.rpartition(".")


def _tick(group: Any, name: str) -> None:
    if getattr(group, GIVEN + name, None) is False:
        with taking():  # what a tick by hand does beside that would take back the value
            setattr(group, GIVEN + name, True)


@contextmanager
def taking() -> Iterator[None]:
    """Set values as a preset has them: nothing follows from a change, and the listeners are told at the end."""
    _taking.append(True)
    try:
        with notify_once():
            yield
    finally:
        _taking.pop()


def is_taking() -> bool:
    """Tell whether values are being set as a preset has them."""
    return bool(_taking)


# --- the walk: what groups say, and groups set by what a preset says ---


def to_document(group: Any, cls: type, file: FileText = str, *, leave: Collection[str] = ()) -> dict[str, Any]:
    """Return what the ticked values of a group say, as a preset has it. file: gives the paths of files."""
    said: dict[str, Any] = {}
    for item in fields(cls):
        if item.name in leave:
            continue
        if (inside := inside_of(cls, item.name)) is not None:
            ticked = is_given(group, item.name)
            wanted = ticked or is_dataclass(item.default)
            held = to_document(getattr(group, item.name), inside, file) if wanted else {}
            if held or ticked:
                said[item.name] = held
        elif is_given(group, item.name):
            said[item.name] = _said(group, cls, item.name, file)
    return said


def is_given(group: Any, name: str) -> bool:
    """Tell whether the preset gives a value."""
    return getattr(group, GIVEN + name)


def _said(group: Any, cls: type, name: str, file: FileText) -> Any:
    if is_line(cls, name):
        return from_line(getattr(group, name), name)
    value = value_of(group, name)
    return file(value) if is_file(cls, name) and value else value


@cache
def is_file(cls: type, name: str) -> bool:
    """Tell whether a field names a file."""
    return any((base, name) in FILES for base in cls.__mro__) or field_of(cls, name).metadata["key"].file is not None


def take(group: Any, spec: Any, given: object, file: FileText = str, *, leave: Collection[str] = ()) -> None:
    """Set a group as a preset says. spec: the dataclass, checked. given: the document that it was made from."""
    cls = type(spec)
    if not isinstance(given, Mapping):
        given = {_shorthand(cls): given}
    for item in fields(cls):
        if item.name in leave:
            continue
        value, said = getattr(spec, item.name), given.get(item.name)
        if is_dataclass(value):
            take(getattr(group, item.name), value, {} if said is None else said, file)
        elif value is not None:
            _set(group, item, spec, said, file)
        setattr(group, GIVEN + item.name, said is not None)


def _set(group: Any, item: Field[Any], spec: Any, said: Any, file: FileText) -> None:
    """Set a field to a checked dataclass's value. said: as the document has it; None where it does not."""
    cls, name, value = type(spec), item.name, getattr(spec, item.name)
    said = value if said is None else said
    if is_line(cls, name):
        setattr(group, name, to_line(said))
    elif isinstance(value, str):
        setattr(group, name, file(value) if is_file(cls, name) and value else value)
    else:
        as_given = isinstance(said, int | float | list | tuple) and not isinstance(value, bool)
        set_value(group, name, said if as_given else value)


def _shorthand(cls: Any) -> str:
    return cls.SHORTHAND


def with_files(spec: Any, given: object, file: FileText) -> Any:
    """Return what a preset says with the paths of files as `file` gives them. spec, given: as `take` has them."""
    cls = type(spec)
    said: dict[str, Any] = dict(given) if isinstance(given, Mapping) else {_shorthand(cls): given}
    for item in fields(cls):
        value = getattr(spec, item.name)
        if said.get(item.name) is None:
            continue
        if is_dataclass(value):
            said[item.name] = with_files(value, said[item.name], file)
        elif is_file(cls, item.name):
            said[item.name] = file(said[item.name])
    return said


def to_line(value: Any) -> str:
    """Return a value as one line of YAML."""
    return json.dumps(value, ensure_ascii=False)


def from_line(text: str, name: str) -> Any:
    """Return the value that a line of YAML says. Raises InputError where it is none."""
    try:
        return read_yaml(text.encode(), Path(name))
    except InputError as error:
        raise InputError(
            "Noisy World panel", f"is no YAML: {text[:60]!r}", where=name, remedy="write it anew"
        ) from error


# --- numbers: Blender's are float32 and int32, and angles in radians ---


def property_name(name: str) -> str:
    """Return the property that holds a value: that of an angle, in radians, is without the unit."""
    return name.removesuffix("_deg")


def value_of(group: Any, name: str) -> Any:
    """Return a property's value as a preset has it: the one that was given, unless it was changed since.

    Else it is the shortest decimal that gives this float32. name: of the value; one that ends in _deg is in degrees.
    """
    value, known = getattr(group, property_name(name)), _exact(group).get(name)
    if isinstance(value, str | bool):
        return value
    if isinstance(value, set):
        items = [item.identifier for item in group.bl_rna.properties[name].enum_items]
        return known if known is not None and set(known) == value else [item for item in items if item in value]
    if isinstance(value, int | float):
        return known if known is not None and _held(name, known, value) == value else _shortest(name, value)
    same = known is not None and all(_held(name, one, held) == held for one, held in zip(known, value, strict=True))
    return known if same else [_shortest(name, held) for held in value]


def set_value(group: Any, name: str, value: Any) -> None:
    """Set a property as `value_of` gives it; what Blender does not hold exactly is stored beside it."""
    before = getattr(group, property_name(name))
    if isinstance(before, str | bool):
        setattr(group, property_name(name), value)
        return
    if isinstance(before, set):
        setattr(group, property_name(name), set(value))
    elif isinstance(before, int | float):
        setattr(group, property_name(name), _held(name, value, before))
    else:
        setattr(group, property_name(name), [_held(name, one, 0.0) for one in value])
    known = _exact(group)
    if known.pop(name, None) is not None:
        group.exact = json.dumps(known)
    value = list(value) if isinstance(value, list | tuple) else value
    if repr(value_of(group, name)) != repr(value):
        group.exact = json.dumps(known | {name: value})


def _exact(group: Any) -> dict[str, Any]:
    text = getattr(group, EXACT, "")
    return json.loads(text) if text else {}


def _held(name: str, value: float, like: float) -> float:
    """Return a number as a property holds it that holds numbers such as `like`."""
    if isinstance(like, int):
        return min(int(value), LARGEST_INT)
    return float(np.float32(math.radians(value) if name.endswith("_deg") else value))


def _shortest(name: str, value: float) -> Any:
    if not isinstance(value, float):
        return value
    if not name.endswith("_deg"):
        return float(str(np.float32(value)))
    angle_deg = math.degrees(value)
    shorter = (float(f"{angle_deg:.{digits}g}") for digits in range(1, 10))
    return next((one for one in shorter if np.float32(math.radians(one)) == np.float32(value)), angle_deg)


# How groups of the tree are drawn: widgets, ticks beside what may be left out, lines of YAML.


OF_IMU = ("device", "translation_m", "rate_hz", "gravity_m_s2", "time_offset_s", "clock_drift_ppm")
COEFFICIENTS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")


def draw_keys(
    layout: bpy.types.UILayout,
    group: Any,
    cls: type,
    *,
    leave: Collection[str] = (),
    only: Collection[str] = (),
    ticked: bool = False,
) -> None:
    """Draw the fields of a dataclass. leave: those that are drawn elsewhere. only: those that are drawn, if not all.

    ticked: whether each has a tick, as without it something else holds than it shows.
    """
    for item in fields(cls):
        if item.name in leave or (only and item.name not in only):
            continue
        if (inside := inside_of(cls, item.name)) is not None:
            draw_keys(layout.box(), getattr(group, item.name), inside)
        else:
            draw_key(layout, group, cls, item.name, ticked=ticked)


def draw_key(layout: bpy.types.UILayout, group: Any, cls: type, name: str, *, ticked: bool = False) -> None:
    """Draw a field; with a tick where something else holds without it than it shows."""
    if not ticked and field_of(cls, name).default is not None and not is_line(cls, name):
        layout.prop(group, property_name(name))
        return
    row = layout.row(align=True)
    field = row.row(align=True)
    field.active = getattr(group, GIVEN + name)
    field.prop(group, property_name(name))
    if hint_of(cls, name) is not bool:
        row.prop(group, GIVEN + name, text="")


def draw_given(layout: bpy.types.UILayout, group: Any, cls: type, *, leave: Collection[str] = ()) -> None:
    """Draw what a preset has given beside the fields that are always there, each with its tick. leave: those fields."""
    for item in fields(cls):
        if item.name in leave:
            continue
        if (inside := inside_of(cls, item.name)) is not None:
            if getattr(group, GIVEN + item.name):
                layout.prop(group, GIVEN + item.name)
                draw_given(layout, getattr(group, item.name), inside)
        elif getattr(group, GIVEN + item.name):
            draw_key(layout, group, cls, item.name, ticked=True)


def draw_lines(layout: bpy.types.UILayout, panel: Any, name: str) -> None:
    """Draw the other scenes or settings of a preset, a line each, with what takes it out. name: of the panel's list."""
    lines = getattr(panel, name)
    if not len(lines):
        return
    header, body = layout.panel(f"noisy_world_{name}", default_closed=True)
    header.label(text=f"{panel.bl_rna.properties[name].name} ({len(lines)})")
    if body is None:
        return
    column = body.column(align=True)
    for place, line in enumerate(lines):
        row = column.row(align=True)
        row.prop(line, "line", text=line.name)
        button: Any = row.operator("noisy_world.remove_line", text="", icon="X")
        button.of, button.place = name, place


def draw_body(layout: bpy.types.UILayout, path: Any) -> None:
    """Draw what carries the camera along a path."""
    layout.prop(path, "use_body", text="Body")
    if path.use_body:
        layout.prop(path.body, "kind", text="Kind")
        layout.prop(path.body, "motion")


def draw_distortion(layout: bpy.types.UILayout, owner: Any, *, rendered: bool) -> None:
    """Draw the lens of a camera or of a recording that distorts. rendered: not laid over a recording."""
    layout.prop(owner, "use_distortion")
    if not owner.use_distortion:
        return
    group = owner.distortion
    layout.prop(group, "model")
    column = layout.column(align=True)
    for name in OF_ANGLE if group.model == MODELS[1] else COEFFICIENTS:
        column.prop(group, name)
    if rendered:
        layout.prop(group, "undistort")


def draw_imu(layout: bpy.types.UILayout, rig: Any) -> None:
    """Draw an IMU: a device, where it sits, its rate and its clock."""
    layout.prop(rig, "use_imu")
    if not rig.use_imu:
        return
    column = layout.column(align=True)
    for name in OF_IMU:
        column.prop(rig.imu, name)
    draw_given(column, rig.imu, ImuSpec, leave=OF_IMU)
