# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages in parts: keys and commands are named by the command line here, and by the panel in `ui`."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeAlias


class Action(Enum):
    """What a user may do; the value is the command line's wording."""

    OTHER_FOLDER = "choose another folder with --out"
    OTHER_NAME = "give it another name"
    OVERWRITE = "replace the dataset with --overwrite"
    RUN_AGAIN = "run the same command again"
    NAME_CAMERA = "name one of its cameras"
    OTHER_CAMERA = "name another camera"
    GIVE_CAMERA = "give the preset's camera, which then holds"
    OTHER_FRAMES = "choose frames"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class CommandLineOnly:
    """What a user of the command line alone may do; other places leave it out of a remedy."""

    text: str

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True)
class PresetKey:
    """A key of a preset, by its whole path or its end. value: what it is to be set to, "" for no such thing."""

    path: str
    value: str = ""

    def __str__(self) -> str:
        return f"{self.path}: {self.value}" if self.value else self.path


@dataclass(frozen=True)
class Subject:
    """What a message is about, at its beginning: a file or a place, and where in it, such as the key of a preset."""

    file: str
    where: str = ""

    def __str__(self) -> str:
        return f"{self.file}: {self.where}: " if self.where else f"{self.file}: "


class Message(str):
    """A text made of parts. As a text it is what the command line says."""

    parts: "tuple[Part, ...]"

    def __new__(cls, *parts: "Part") -> "Message":
        """Join parts; those of a message among them stay what they are, and what says nothing is left out."""
        flat = [inner for part in parts for inner in parts_of(part) if str(inner)]
        made = super().__new__(cls, "".join(f"; {part}" if isinstance(part, Remedy) else str(part) for part in flat))
        made.parts = tuple(flat)
        return made

    def __reduce__(self) -> "tuple[type[Message], tuple[Part, ...]]":
        return Message, self.parts


@dataclass(frozen=True)
class Remedy:
    """What to do about it, at the end of a message. ways: one of them is enough."""

    ways: tuple[Message, ...]

    def __str__(self) -> str:
        return one_of(self.ways)


Part: TypeAlias = str | Action | CommandLineOnly | PresetKey | Subject | Remedy


def either(*ways: Part) -> Remedy:
    """Return a remedy of one way, or of several of which one is enough; "" is none."""
    return Remedy(tuple(Message(way) for way in ways if way))


def one_of(ways: Sequence[str]) -> str:
    """Return ways of which one is enough in words: "a, b, or c"; "" for none."""
    *others, last = ways or ("",)
    return f"{', '.join(others)}, or {last}" if others else last


def parts_of(text: Part) -> tuple[Part, ...]:
    """Return the parts of a message; of anything else itself."""
    return text.parts if isinstance(text, Message) else (text,)


def offers(message: str, action: Action) -> bool:
    """Tell whether an action is among the ways of a message's remedy."""
    remedies = (part for part in parts_of(message) if isinstance(part, Remedy))
    return any(action in way.parts for remedy in remedies for way in remedy.ways)


# --- between processes ---


def to_content(part: Part) -> Any:
    """Return a part of a message, or a message, as JSON has it."""
    match part:
        case Message():
            return [to_content(inner) for inner in part.parts]
        case Action():
            return {"action": part.name}
        case CommandLineOnly(text):
            return {"command_line": text}
        case PresetKey(path, value):
            return {"key": [path, value]}
        case Subject(file, where):
            return {"subject": [file, where]}
        case Remedy(ways):
            return {"ways": [to_content(way) for way in ways]}
        case str():
            return part


def from_content(content: Any) -> Any:
    """Return the part or the message that `to_content` gave as JSON."""
    match content:
        case list():
            return Message(*map(from_content, content))
        case {"action": name}:
            return Action[name]
        case {"command_line": text}:
            return CommandLineOnly(text)
        case {"key": [path, value]}:
            return PresetKey(path, value)
        case {"subject": [file, where]}:
            return Subject(file, where)
        case {"ways": ways}:
            return Remedy(tuple(map(from_content, ways)))
        case _:
            return content
