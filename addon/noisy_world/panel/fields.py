# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender properties from the fields of dataclasses, in Blender's wording, and the listeners to their changes."""

import math
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, Field, dataclass, fields
from importlib.util import find_spec
from typing import Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

import bpy

from ..core.errors import american, title
from ..core.schema import KeyInfo, label_of, tooltip_of
from ..perturbations.shipped.faster_motion import FasterMotion
from ..perturbations.shipped.motion_deviation import MotionDeviation
from ..preset.keys import CameraSpec, OnlySpec, OutputSpec, PresetSpec, RenderSpec, RigSpec, SensorSpec, SettingSpec
from ..preset.scene_keys import BodySpec, HandheldSpec, SceneKeys, TrajectorySpec
from ..preset.sensor_keys import DistortionSpec
from ..sources import SOURCES

SCENE, TRAJECTORY, DEVIATION, CAMERA = "Scene", "Trajectory", "Deviation and Speed", "Camera"
PERTURBATIONS, GENERATE, OUTPUT, RIG = "Perturbations", "Generate", "Render and Output", "Rig and Sensors"
SECTIONS: dict[type, str] = {
    **{kind.keys: SCENE for kind in SOURCES.values()}, SceneKeys: SCENE,
    TrajectorySpec: TRAJECTORY, HandheldSpec: TRAJECTORY, BodySpec: TRAJECTORY,
    CameraSpec: CAMERA, DistortionSpec: CAMERA, RenderSpec: OUTPUT,
    OutputSpec: OUTPUT, RigSpec: RIG, SensorSpec: RIG, SettingSpec: OUTPUT, OnlySpec: OUTPUT, PresetSpec: OUTPUT,
    MotionDeviation: DEVIATION, FasterMotion: DEVIATION,
}  # fmt: skip
"""The sections of the tabs that show the fields of dataclasses."""


@dataclass(frozen=True)
class ShownField:
    """A field of the tab: `Section > Label`, and the labels of the values that it chooses from."""

    label: str
    choices: dict[str, str]


SHOWN: dict[tuple[Any, str], ShownField] = {}
"""The fields of the tab by dataclass and name of what they give."""

Listener: TypeAlias = Callable[[bpy.types.Scene, frozenset[str]], None]
"""Called with the scene and the names of the changed properties; "steps" for everything inside a perturbation."""

LISTENERS: list[Listener] = []
_collected: list[dict[tuple[int, str], bpy.types.Scene]] = []  # inside notify_once
LARGEST_INT = 2**31 - 1  # of Blender's integer properties, which have 32 bits
EMBREE = "embree"  # of engines the last, so that the others keep their numbers in files where it is not offered
_LEAST_ABOVE = 1e-6  # what an exclusive minimum is raised by, as Blender's are inclusive; chosen
_SUBTYPES = {
    "px": "PIXEL", "m": "DISTANCE", "mm": "DISTANCE_CAMERA", "%": "PERCENTAGE", "deg": "ANGLE", "s": "TIME_ABSOLUTE",
}  # fmt: skip
_SPOKEN_UNITS = {"frames": "frames", "Hz": "Hz"}
_FRAME_RATE = "Frame Rate"  # which artists count in fps
_INT_SUBTYPES: dict[str, dict[str, Any]] = {"px": {"subtype": "PIXEL"}, "frames": {"subtype": "TIME"}}
_IN_UNITS = ("default", "min", "max", "soft_min", "soft_max")

# --- properties from dataclasses ---


def described(
    cls: type,
    name: str,
    *,
    label: str = "",
    section: str = "",
    update: str | Callable[[Any, bpy.types.Context], None] = "",
    **other: Any,
) -> Any:
    """Return a property for a dataclass's field, with the field's tooltip, range, unit, slider and default.

    An angle is in radians there, as Blender's are. Presets hold no keyframes, so it cannot be animated.
    label: replaces the field's name. section: of the tab, where it is not that of the dataclass. update: the name that
    listeners are called with, or a function that calls them. other: arguments that override the field's.
    """
    item: Field[Any] = next(field for field in fields(cls) if field.name == name)
    info: KeyInfo = item.metadata["key"]
    hint = plain_hint(get_type_hints(cls)[name])
    label, items = label or label_of(cls, name), _items(hint, info)
    choices = {"true": "On", "false": "Off"} if hint is bool else {value: shown for value, shown, _ in items}
    SHOWN[cls, name] = ShownField(f"{section or section_of(cls)} > {label}", choices)
    if info.unit in _SPOKEN_UNITS:
        label += f" ({'fps' if label == _FRAME_RATE else _SPOKEN_UNITS[info.unit]})"
    on_change = tell(update or name) if isinstance(update, str) else update
    common: dict[str, Any] = {
        "name": label,
        "description": sentence(tooltip_of(cls, name)),
        "update": on_change,
        "options": set(),
    }
    if item.default is not MISSING and item.default is not None:
        common["default"] = set(item.default) if items and get_origin(hint) is tuple else item.default
    if "description" in other:
        other["description"] = sentence(other["description"])
    if items:
        items = [(value, word if is_offered(value) else f"{word} (Missing)", said) for value, word, said in items]
        chosen: dict[str, Any] = {"items": items}
        if get_origin(hint) is tuple:
            common["options"] = {"ENUM_FLAG"}
        return bpy.props.EnumProperty(**(chosen | common | other))
    if get_origin(hint) is tuple:
        size: dict[str, Any] = {"size": len(get_args(hint)), "subtype": "XYZ" if len(get_args(hint)) == 3 else "NONE"}
        return bpy.props.FloatVectorProperty(**(size | _range(float, info, common | other)))
    if hint is bool:
        return bpy.props.BoolProperty(**(common | other))
    if hint is str:
        named: dict[str, Any] = (
            {} if info.file is None else {"subtype": "FILE_PATH", "options": {"PATH_SUPPORTS_BLEND_RELATIVE"}}
        )
        return bpy.props.StringProperty(**(common | named | other))
    if info.slider is not None:
        common["soft_min"], common["soft_max"] = info.slider
    return _number(hint, info, common | other)


def _items(hint: Any, info: KeyInfo) -> list[tuple[str, str, str]]:
    """Return the choices of a field, with label and tooltip; [] for a field without choices."""
    values = get_args(hint) if get_origin(hint) is Literal else tuple(info.choices or ())
    words = {value: (american(item.label), american(item.meaning)) for value, item in (info.choices or {}).items()}
    return [(value, *words.get(value, (title(value), ""))) for value in values]


def is_offered(value: str) -> bool:
    """Tell whether a value can be chosen in this Blender: Embree needs a package that the extension does not bring."""
    return value != EMBREE or find_spec("embreex") is not None


def section_of(cls: type) -> str:
    """Return the section of the tab that shows a dataclass, or one that it is made from."""
    return next((SECTIONS[base] for base in cls.__mro__ if base in SECTIONS), OUTPUT)


def _range(hint: type, info: KeyInfo, common: dict[str, Any]) -> dict[str, Any]:
    if info.minimum is not None:
        common.setdefault("min", hint(info.minimum))
    if info.above is not None:
        common.setdefault("min", hint(info.above) + (1 if hint is int else _LEAST_ABOVE))
    if info.maximum is not None:
        common.setdefault("max", min(hint(info.maximum), LARGEST_INT) if hint is int else info.maximum)
    for soft, wider, hard in (("soft_min", max, "min"), ("soft_max", min, "max")):
        if soft in common:
            common[soft] = hint(wider(common[soft], common.get(hard, common[soft])))
    return common


def _number(hint: type, info: KeyInfo, common: dict[str, Any]) -> Any:
    common = _range(hint, info, common)
    if hint is int:
        return bpy.props.IntProperty(**_INT_SUBTYPES.get(info.unit, {}), **common)
    if info.unit == "deg":
        common |= {name: math.radians(common[name]) for name in _IN_UNITS if name in common}
    factor = (common.get("min"), common.get("max")) == (0.0, 1.0) and not info.unit
    common.setdefault("subtype", "FACTOR" if factor else _SUBTYPES.get(info.unit, "NONE"))
    precise: dict[str, Any] = {"precision": 3, "step": 100 if info.unit == "deg" else 1}
    if info.unit == "m/s":
        precise["unit"] = "VELOCITY"
    return bpy.props.FloatProperty(**(precise | common))


def plain_hint(hint: Any) -> Any:
    """Return a type without None."""
    if get_origin(hint) in (Union, types.UnionType):
        return next(option for option in get_args(hint) if option is not type(None))
    return hint


def sentence(text: str) -> str:
    """Return a text as a tooltip: with a capital first letter, no full stop at the end, in Blender's spelling."""
    return american(text[:1].upper() + text[1:].rstrip("."))


def tell(name: str) -> Callable[[Any, bpy.types.Context], None]:
    """Return an update function that calls the listeners with the scene and this name."""

    def update(group: Any, _: bpy.types.Context) -> None:
        if _collected:
            _collected[-1].setdefault((group.id_data.session_uid, name), group.id_data)
            return
        for listener in LISTENERS:
            listener(group.id_data, frozenset((name,)))

    return update


def choice(update: str, label: str, meaning: str, *items: tuple[str, str, str], default: str = "") -> Any:
    """Return an enumeration of identifiers, labels and meanings.

    update: what the listeners are told of a change. default: "" for the first one.
    """
    chosen: dict[str, Any] = {"items": list(items), "default": default or items[0][0]}
    return bpy.props.EnumProperty(options=set(), name=label, description=meaning, update=tell(update), **chosen)


@contextmanager
def notify_once() -> Iterator[None]:
    """Delay the listeners to the end of the outermost such context, and call each once for a scene with all changes."""
    _collected.append({})
    try:
        yield
    finally:
        changes = _collected.pop()
        if _collected:
            _collected[-1].update(changes)
            changes = {}
        scenes = {uid: scene for (uid, _), scene in changes.items()}
        for uid, scene in scenes.items():
            names = frozenset(name for other, name in changes if other == uid)
            for listener in LISTENERS:
                listener(scene, names)


# Handlers of Blender's events, which a module of the panel adds and removes together.


class Handlers:
    """Functions by the names of Blender's lists of handlers, such as load_post. Those that stay with another file are
    marked `persistent`."""

    def __init__(self, **functions: Callable[..., None]) -> None:
        self._functions = functions

    def add(self) -> None:
        """Have them called."""
        for handlers, function in self._places():
            handlers.append(function)

    def remove(self) -> None:
        """Have them called no more."""
        for handlers, function in self._places():
            handlers.remove(function)

    def _places(self) -> Iterator[tuple[list[Any], Callable[..., None]]]:
        for name, function in self._functions.items():
            yield getattr(bpy.app.handlers, name), function
