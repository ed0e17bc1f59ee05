# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user can mend: errors in one line, suggestions for misspelt names, and parameters' names for people.

What a user can mend: errors in one line, messages in parts, suggestions for misspelt names, exit statuses.

The errors that a user can cause and mend.

On the command line each becomes a single line and a non-zero exit status, in the add-on a report in the status bar. Any
other exception is a bug and keeps its traceback.
"""

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeAlias

# Messages in parts: keys and commands are named by the command line here, and by the panel in `ui`.


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


class NoisyWorldError(Exception):
    """What went wrong, where, and what to do about it, in one line: `FILE: WHERE: PROBLEM; REMEDY`.

    message: the line in its parts, for a place that has words of its own for keys and remedies.
    """

    def __init__(self, problem: str, *, file: object = "", where: str = "", remedy: Part = "") -> None:
        self.file, self.where, self.problem = str(file), where, problem
        self.remedy = remedy if isinstance(remedy, Remedy) else either(remedy)
        about = (Subject(self.file, where),) if self.file else ()
        self.message = Message(*map(_in_one_line, Message(*about, problem, self.remedy).parts))
        super().__init__(one_line(self.message))


def _in_one_line(part: Part) -> Part:
    match part:
        case str():
            return one_line(part)
        case Subject(file, where):
            return Subject(one_line(file), one_line(where))
        case _:
            return part


def one_line(text: str) -> str:
    """Return a text with what a line cannot show as Python's escapes: line ends, bytes of names that are not UTF-8."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else _escaped(letter) for letter in text)


def _escaped(letter: str) -> str:
    """Return the escape of a letter; of a byte that stands as half a surrogate pair, as Python reads names, its own."""
    byte = ord(letter) - 0xDC00
    return f"\\x{byte:02x}" if 0x80 <= byte <= 0xFF else ascii(letter)[1:-1]


class InputError(NoisyWorldError):
    """A file that the user gave is not what it should be. where: a key of a preset, or a line of a text file."""

    def __init__(self, file: str | Path, problem: str, *, where: str = "", remedy: Part = "") -> None:
        super().__init__(problem, file=file, where=where, remedy=remedy)


class NotFiniteError(InputError):
    """A file of poses can be read, but holds NaN or infinity where a pose has to be."""


class MissingDependencyError(NoisyWorldError):
    """A library that is needed is not installed; the message gives the command that installs it."""


class StorageError(NoisyWorldError):
    """The dataset cannot be written or continued in its folder: disk full, no permission, or another run's data."""


class BusyError(StorageError):
    """Another process is writing there."""


class CannotJoinError(StorageError):
    """This process does not see the run that it is to take part in, or would make other bytes."""


class OutOfMemoryError(NoisyWorldError):
    """This process got no more memory."""


@contextmanager
def memory_errors() -> Iterator[None]:
    """Turn want of memory, numpy's, OpenCV's and that of threads, into one line. Raises OutOfMemoryError."""
    try:
        yield
    except Exception as error:
        if not (isinstance(error, MemoryError) or _is_opencvs(error) or str(error) == _NO_THREAD):
            raise
        more = "" if _is_opencvs(error) or not str(error) else f": {error}"
        raise OutOfMemoryError(f"memory is short{more}", remedy=MORE_MEMORY) from error


MORE_MEMORY = either("make the images smaller", "run it where there is more memory")
_OPENCV_NO_MEMORY = -4  # cv2.Error.StsNoMem
_NO_THREAD = "can't start new thread"  # Python's, a RuntimeError, where there is no room for its stack


def _is_opencvs(error: Exception) -> bool:
    return type(error).__module__ == "cv2" and getattr(error, "code", None) == _OPENCV_NO_MEMORY


class InterruptedRunError(NoisyWorldError):
    """The user stopped the run; the message says how to continue it."""


# Suggestions for misspelt names: keys, commands, options, presets, perturbations, folders.


LONGEST = 60  # characters of a name that are compared: the time grows with their square
LEAST = 0.5  # likeness, from 0 to 1; difflib's own limit of 0.6 misses short names with one wrong letter


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is most like a name; None where none is like it."""
    near = difflib.get_close_matches(name[:LONGEST], list(known), n=1, cutoff=LEAST)
    return near[0] if near else None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a question that gives the nearest known name; "" where none is like it."""
    near = nearest(name, known)
    return "" if near is None else f"did you mean {near!r}?"


# Exit statuses of commands.


DONE = 0
USERS_ERROR = 1  # a line on standard error says what to mend
REFUSED = 3  # of a worker on a machine that could not do any task as the others do
BUSY = 75  # of one whose task another process does; EX_TEMPFAIL of sysexits.h
INTERRUPTED = 130  # 128 + SIGINT (2): the exit status that shells give a program ended by Ctrl-C
KILLED = 9  # the signal that nothing hears: the system's, where memory is short
READER_GONE = 141  # 128 + SIGPIPE (13): that of a program whose output nobody reads any more


def how_it_ended(status: int) -> str:
    """Return in words how a process ended that did not mean to. status: negative where a signal ended it."""
    if status >= 0:
        return f"ended with status {status}"
    return f"was ended by signal {-status}{', perhaps for want of memory' if status == -KILLED else ''}"


# Names of parameters for people: the same in the panel and on node groups' sockets, in Blender's wording.


UNIT_SUFFIXES = (
    "_px",
    "_deg",
    "_m",
    "_mm",
    "_percent",
    "_hz",
    "_m_s",
    "_mm_h",
    "_mrad",
    "_ms",
    "_per_s",
    "_db",
    "_stops",
    "_s",
)
_SMALL_WORDS = ("by", "of", "to", "and", "on", "in", "the")
_AMERICAN = {
    "colour": "color", "colours": "colors", "coloured": "colored", "grey": "gray", "greys": "grays",
    "centre": "center", "centres": "centers", "metre": "meter", "metres": "meters", "neighbour": "neighbor",
    "neighbours": "neighbors", "synchronisation": "synchronization", "desynchronisation": "desynchronization",
    "quantised": "quantized", "normalised": "normalized", "optimised": "optimized", "recognised": "recognized",
    "kerb": "curb", "licence": "license", "behaviour": "behavior", "favour": "favor", "minimise": "minimize",
}  # fmt: skip
# Not inside the name of a file: after or before a slash, a dot, a dash or an underscore.
_WORD = re.compile(rf"(?<![\w/\\.-])({'|'.join(_AMERICAN)})(?![\w/\\-]|\.\w)", re.IGNORECASE)


def title(text: str) -> str:
    """Return a label as Blender writes them: "fog by depth" -> "Fog by Depth"."""
    words = text.replace("_", " ").split()
    return american(
        " ".join(
            word if (place and word in _SMALL_WORDS) or not word[0].islower() else word[0].upper() + word[1:]
            for place, word in enumerate(words)
        )
    )


def parameter_label(name: str) -> str:
    """Return a parameter's name in words, without its unit, which the slider shows."""
    for suffix in UNIT_SUFFIXES:
        name = name.removesuffix(suffix)
    return title(name)


def american(text: str) -> str:
    """Return a text in the spelling of Blender's interface; names of files in it stay as they are."""

    def spelt(match: re.Match[str]) -> str:
        word = match.group()
        other = _AMERICAN[word.lower()]
        return other.upper() if word.isupper() else other.capitalize() if word[0].isupper() else other

    return _WORD.sub(spelt, text)
