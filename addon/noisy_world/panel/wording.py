# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages in the panel's words: fields and buttons instead of a preset's keys and a command line's options."""

from collections.abc import Iterable
from typing import Any, cast

from ..core.errors import Action, CommandLineOnly, Part, PresetKey, Remedy, Subject, american, one_of, parts_of, title
from ..core.schema import fields_on
from ..perturbations import registry
from ..preset.keys import PresetSpec
from ..sources import SOURCES
from .document import PANEL
from .fields import CAMERA, DEVIATION, GENERATE, PERTURBATIONS, SCENE, SHOWN, TRAJECTORY, ShownField
from .properties import NoisyWorldStep

ACTIONS = {
    Action.OTHER_FOLDER: "choose another folder under Output",
    Action.OTHER_NAME: f"give Scene > Name or {GENERATE} > Setting another name",
    Action.OVERWRITE: "press Replace Dataset",
    Action.RUN_AGAIN: "press Generate again",
    Action.NAME_CAMERA: "make one of its cameras the scene's",
    Action.OTHER_CAMERA: "make another camera the scene's",
    Action.GIVE_CAMERA: f"tick {CAMERA} > Give Intrinsics, and choose numbers that then hold",
    Action.OTHER_FRAMES: "choose another range of frames in the timeline",
}
"""How each thing that a user may do is done here."""

_WITHOUT_PROPERTY = {
    "scenes": SCENE,
    "scenes.blend": "This Scene", "scenes.scene": "This Scene", "scenes.camera": f"{TRAJECTORY} > Scene Camera",
    "scenes.frames": f"{TRAJECTORY} > Scene Camera", "settings": PERTURBATIONS, "perturbations": PERTURBATIONS,
    "motion": DEVIATION,
}  # fmt: skip
"""The field of the panel for keys that no property of its own gives; without the numbers of lists."""

_OF_STEP = {"levels": "severity"}
"""The property of an entry of the list that gives a key of another name."""


def spoken(message: str, file: str = PANEL) -> str:
    """Return a message in the panel's words. file: the preset that it may name, which stands for the panel."""
    return american(_joined(parts_of(message), file))


def noted(note: str) -> str:
    """Return a note in the panel's words, as a sentence that stands by itself."""
    text = spoken(note)
    return text[:1].upper() + text[1:]


def _joined(parts: Iterable[Part], file: str) -> str:
    return "".join(_said(part, file) for part in parts)


def _said(part: Part, file: str) -> str:
    match part:
        case Subject(named, where) if named in (file, PANEL):
            return f"{field_of(where)}: " if where else ""
        case Remedy(ways):
            message = one_of([said for way in ways if (said := _joined(way.parts, file))])
            return f"; {message}" if message else ""
        case Action():
            return ACTIONS[part]
        case CommandLineOnly():
            return ""
        case PresetKey(path, value):
            return _key(path, value)
        case _:
            return str(part)


def _key(path: str, value: str) -> str:
    """Return the field for a key that may be the end of one; with a value, how that is set."""
    name = path.rpartition(".")[2]
    found = _shown(path) or next((shown for (_, key), shown in SHOWN.items() if key == name), None)
    if not value:
        return found.label.rpartition(" > ")[2] if found else path
    return f"{found.label}: {_chosen(found, value)}" if found else f"{path}: {value} in the saved preset"


def _chosen(field: ShownField, value: str) -> str:
    """Return a value, or each of a list in brackets, in the words of the field."""
    if value[:1] == "[":
        return ", ".join(field.choices.get(each.strip(), each) for each in value.strip("[]").split(","))
    return field.choices.get(value, value)


def _shown(path: str) -> ShownField | None:
    """Return the field or the section that shows all that a key is."""
    names = [name for name in path.split(".") if not name.isdigit()]
    if label := _WITHOUT_PROPERTY.get(".".join(names)):
        return ShownField(label, {})
    begins = [(PresetSpec, names)]
    if names[0] == "scenes":
        begins = [(kind.keys, names[1:]) for kind in SOURCES.values()]
    for begin, inner in begins:
        on_path = list(fields_on(begin, ".".join(inner)))
        if not inner or len(on_path) < len(inner):
            continue
        cls, name, _ = on_path[-1]
        if found := next((SHOWN[base, name] for base in cls.__mro__ if (base, name) in SHOWN), None):
            return found
    return None


def field_of(key: str) -> str:
    """Return the field of the panel that gives a key of a preset; the key itself where there is none."""
    names = key.split(".")
    for place, name in enumerate(names[1:], 1):
        if name in registry() and names[place - 1].isdigit():
            return _field_of_step(name, names[place + 1 :])
    on_the_way = (_shown(".".join(names[:end])) for end in range(len(names), 0, -1))
    return next((shown.label for shown in on_the_way if shown), key)


def _field_of_step(name: str, inside: list[str]) -> str:
    perturbation = registry()[name]
    label = title(perturbation.label)
    if not inside:
        return label
    shown = SHOWN.get((perturbation.parameters, inside[0]))
    own = cast("Any", NoisyWorldStep).bl_rna.properties.get(_OF_STEP.get(inside[0], inside[0]))
    return shown.label if shown else f"{label} > {own.name if own else inside[0]}"
