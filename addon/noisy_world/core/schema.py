# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain values from YAML, in bounded time and memory, and frozen dataclasses from these, with errors that name the key.

Turning plain YAML values into frozen dataclasses, with errors that name file, key and the nearest valid name.

A dataclass describes itself: `key(...)` holds a field's meaning, unit, range and choices. The checks, the list of keys
and the panel's sliders are derived from it.
"""

import math
import re
import types
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Literal,
    Protocol,
    TypeAlias,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from .errors import InputError, Part, did_you_mean, parameter_label

if TYPE_CHECKING:
    import yaml


Item = TypeVar("Item")

InIdentity: TypeAlias = Literal["value", "meaning", "nothing"]

_TRUTH = {"on": True, "yes": True, "true": True, "off": False, "no": False, "false": False}
"""Words that YAML 1.1 reads as truth values, where they are not in quotes; as choices they are meant as words."""

LONGEST_QUOTED = 60  # characters of a user's text that a message repeats


class Dataclass(Protocol):
    """Every dataclass, for annotations."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


@dataclass(frozen=True)
class Choice:
    """A value that a key may have: its label for people, and its meaning."""

    label: str
    meaning: str


class ChoicesOf(Mapping[str, Choice]):
    """Choices that come from a registry, of which each thing is imported when it is asked for."""

    def __init__(
        self, registry: Mapping[str, Item], words: Callable[[Item], Choice], others: Mapping[str, Choice] | None = None
    ) -> None:
        """Return those of a registry by `words`. others: choices that stand before them."""
        self._registry: Mapping[str, Any] = registry
        self._words = words
        self._others = others or {}

    def __getitem__(self, name: str) -> Choice:
        return self._others[name] if name in self._others else self._words(self._registry[name])

    def __iter__(self) -> Iterator[str]:
        yield from self._others
        yield from self._registry

    def __len__(self) -> int:
        return len(self._others) + len(self._registry)


@dataclass(frozen=True)
class KeyInfo:
    """What a key means. minimum and maximum are inclusive; above is an exclusive minimum.

    says: the meaning, or what works it out when it is read, where that takes a registry. choices: the words of each
    text that it may be; the texts too, where the field's type does not give them. identity: how it stands in the
    identity of a dataset, which says what decided its bytes. file: of a text that names a file: reads it, to check it.
    label, slider, later: as `key` has them.
    """

    says: str | Callable[[], str]
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    pattern: Callable[[str], str] | None = None
    choices: Mapping[str, Choice] | None = None
    identity: "InIdentity" = "value"
    file: Callable[[Path], Any] | None = None
    label: str = ""
    slider: tuple[float, float] | None = None
    later: bool = False

    @property
    def meaning(self) -> str:
        """What the key means, for people."""
        return self.says if isinstance(self.says, str) else self.says()


def key(
    meaning: str | Callable[[], str],
    *,
    default: Any = MISSING,
    default_factory: Any = MISSING,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    above: float | None = None,
    pattern: Callable[[str], str] | None = None,
    choices: Mapping[str, Choice] | None = None,
    identity: "InIdentity" = "value",
    file: Callable[[Path], Any] | None = None,
    label: str = "",
    slider: tuple[float, float] | None = None,
    later: bool = False,
) -> Any:
    """Declare a dataclass field that a preset may set.

    meaning: a text, or a function that returns it, where that takes a registry. pattern: a function that returns what
    is wrong with a text, or nothing. choices: label and meaning of each value, as this field means it; where the type
    is no Literal, as where values come from a registry, these are the values that are allowed. identity: "value" where
    the value decides bytes, so that it stands in a dataset's identity as it is, unless it is the default; "meaning"
    where what it means stands there in another form, as poses or hashes; "nothing" where it decides no byte. file: of
    a perturbation's parameter that names a file, "" for none: a function that reads it, and raises OSError, or
    ValueError with what is wrong. label: its name for people, where that is not the key's own in words. slider: where a
    slider ends, as that is of use; the keyboard reaches the whole range. later: of a perturbation's parameter that
    datasets were made without: its default changes nothing, and is not told.

    A dataclass may say in a class attribute TOOLTIPS, by the names of fields, what one sees when a value grows.
    """
    info = KeyInfo(meaning, unit, minimum, maximum, above, pattern, choices, identity, file, label, slider, later)
    return field(default=default, default_factory=default_factory, metadata={"key": info})


def key_of(cls: Any, name: str, **other: Any) -> Any:
    """Return a field that means what that of another dataclass does, with its default. other: of its KeyInfo."""
    item = cls.__dataclass_fields__[name]
    info = replace(item.metadata["key"], **other)
    return field(default=item.default, default_factory=item.default_factory, metadata={"key": info})


def held_by(cls: Any, name: str) -> Any:
    """Return the dataclass that a field of a dataclass holds; None where it holds none."""
    hint, _ = _unwrap(get_type_hints(cls)[name])
    return hint if isinstance(hint, type) and is_dataclass(hint) else None


def info_of(cls: Any, name: str) -> KeyInfo:
    """Return what is said of a dataclass's field."""
    return cls.__dataclass_fields__[name].metadata["key"]


def label_of(cls: type, name: str) -> str:
    """Return a field's name for people: its own label, or else its key in words, without the unit."""
    return info_of(cls, name).label or parameter_label(name)


def tooltip_of(cls: type, name: str) -> str:
    """Return what a person reads of a field: what its class, or one that it is made from, says of it in TOOLTIPS.

    That is by default its meaning.
    """
    each = (base.__dict__.get("TOOLTIPS", {}) for base in cls.__mro__)
    tooltip = next((tooltips[name] for tooltips in each if name in tooltips), "")
    return tooltip or info_of(cls, name).meaning


@dataclass(frozen=True)
class ConfigPath:
    """Where a value is in a preset: the file and the keys that lead to it.

    data: the folder that paths begin at, where that is not the file's own.
    """

    file: str | Path
    path: str = ""
    data: Path | None = None

    @property
    def folder(self) -> Path:
        """The folder that paths in values begin at; where no file is read, that in which the program runs."""
        return self.data or (self.file.parent if isinstance(self.file, Path) else Path())

    def at(self, name: str | int) -> "ConfigPath":
        """Return the place of a value inside this one."""
        text = str(name)
        step = text if text.isprintable() and 0 < len(text) <= LONGEST_QUOTED else quoted(text)
        return ConfigPath(self.file, f"{self.path}.{step}" if self.path else step, self.data)

    def error(self, problem: str, remedy: Part = "") -> InputError:
        """Return an error that names this place."""
        return InputError(self.file, problem, where=self.path, remedy=remedy)


T = TypeVar("T", bound=Dataclass)


def parse(cls: type[T], value: object, place: ConfigPath) -> T:
    """Check `value` against the dataclass `cls` and build it; raise InputError on the first thing that is wrong.

    If `cls` has a class attribute `SHORTHAND`, a value that is not a mapping sets the field of that name.
    """
    shorthand = getattr(cls, "SHORTHAND", None)
    if shorthand and not isinstance(value, Mapping):
        value = {shorthand: value}
    if not isinstance(value, Mapping):
        raise place.error(f"is {describe(value)}, but has to be a mapping of {', '.join(_names(cls))}")
    hints = get_type_hints(cls)
    known = {item.name: item for item in fields(cls)}
    for name in value:
        if name not in known:
            raise unknown_name(place.at(str(name)), "key", str(name), list(known))
    arguments = {}
    for name, item in known.items():
        if name in value:
            arguments[name] = _parse_value(hints[name], value[name], place.at(name), item)
        elif item.default is MISSING and item.default_factory is MISSING:
            raise place.at(name).error("is missing", f"add it: {item.metadata['key'].meaning}")
    make: Callable[..., T] = cls
    return make(**arguments)


def unknown_name(place: ConfigPath, kind: str, name: str, known: Sequence[str]) -> InputError:
    """Return the error for an unknown name, with the nearest known one."""
    remedy = did_you_mean(name, known) or f"known here: {', '.join(known)}"
    return place.error(f"unknown {kind} {quoted(name)}", remedy)


def quoted(value: str | float) -> str:
    """Return a text in quotes, or a number, as short as a message needs it."""
    if isinstance(value, str):
        cut = value if len(value) <= LONGEST_QUOTED else value[:LONGEST_QUOTED]
        return repr(cut) if cut is value else f"{cut!r}... ({len(value)} characters)"
    if isinstance(value, int) and value.bit_length() > 64:
        return f"{'-' if value < 0 else ''}2^{value.bit_length() - 1} or more"
    return str(value)


def describe(value: object) -> str:
    """Describe a YAML value in words, for messages."""
    match value:
        case None:
            return "empty"
        case bool():
            return f"the truth value {str(value).lower()}"
        case int() | float():
            return f"the number {quoted(value)}"
        case str():
            return f"the text {quoted(value)}"
        case Mapping():
            return "a mapping"
        case Sequence() if not isinstance(value, bytes):
            return "a list"
        case _:
            return f"a {type(value).__name__}"


def _names(cls: type[Dataclass]) -> list[str]:
    return [item.name for item in fields(cls)]


def _parse_value(hint: Any, value: object, place: ConfigPath, item: Field[Any]) -> Any:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        options = get_args(hint)
        if value is None and type(None) in options:
            return None
        (hint,) = (option for option in options if option is not type(None))
        return _parse_value(hint, value, place, item)
    if origin is Literal:
        return _parse_choice(get_args(hint), value, place)
    if hint is str and (choices := item.metadata["key"].choices) is not None:
        return _parse_choice(choices, value, place)
    if origin is tuple:
        return _parse_list(get_args(hint), value, place, item)
    if isinstance(hint, type) and is_dataclass(hint):
        return parse(hint, value, place)
    if hint is Any:  # checked later, by the code that uses it
        return value
    return _parse_plain(hint, value, place, item.metadata["key"])


def _parse_choice(choices: Collection[str], value: object, place: ConfigPath) -> str:
    if isinstance(value, str) and value in choices:
        return value
    if isinstance(value, str):
        raise unknown_name(place, "value", value, tuple(choices))
    if isinstance(value, bool) and len(meant := [word for word in choices if _TRUTH.get(word) is value]) == 1:
        return meant[0]
    raise place.error(f"is {describe(value)}, but has to be one of {', '.join(choices)}")


def _parse_list(hints: tuple[Any, ...], value: object, place: ConfigPath, item: Field[Any]) -> tuple[Any, ...]:
    if isinstance(value, (str, bytes)) or not isinstance(value, Sequence):
        raise place.error(f"is {describe(value)}, but has to be a list", "put it in [ ]")
    if len(hints) == 2 and hints[1] is Ellipsis:
        hints = (hints[0],) * len(value)
    if len(value) != len(hints):
        raise place.error(f"has {len(value)} entries, but has to have {len(hints)}")
    return tuple(
        _parse_value(hint, entry, place.at(index), item)
        for index, (hint, entry) in enumerate(zip(hints, value, strict=True))
    )


def _parse_plain(hint: type, value: object, place: ConfigPath, info: KeyInfo) -> object:
    if hint in (int, float) and isinstance(value, (int, float)) and not isinstance(value, bool):
        if hint is float or isinstance(value, int) or value.is_integer():
            return _parse_number(hint, value, place, info)
    elif hint is str and isinstance(value, str):
        if info.pattern and (problem := info.pattern(value)):
            raise place.error(problem)
        return value
    elif hint is bool and isinstance(value, bool):
        return value
    wanted = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}[hint]
    remedy = "put it in quotes" if hint is str and isinstance(value, (bool, int, float)) else ""
    raise place.error(f"is {describe(value)}, but has to be {wanted}", remedy)


def _parse_number(hint: type, value: float, place: ConfigPath, info: KeyInfo) -> float:
    try:
        number = hint(value)
        finite = math.isfinite(number)
    except OverflowError:
        number, finite = math.inf, False
    if not finite:
        raise place.error(f"is {quoted(value)}, but has to be finite")
    too_low = info.minimum is not None and number < info.minimum
    too_high = info.maximum is not None and number > info.maximum
    if too_low or too_high or (info.above is not None and number <= info.above):
        raise place.error(f"is {quoted(value)}{_unit(info)}, out of range", f"allowed: {allowed_range(info)}")
    return number


def _unit(info: KeyInfo) -> str:
    return f" {info.unit}" if info.unit else ""


def allowed_range(info: KeyInfo) -> str:
    """Return the range of a number in words, "" where there is none."""
    low, high = (None if bound is None else number_text(bound) for bound in (info.minimum, info.maximum))
    if info.above is not None:
        return f"above {number_text(info.above)}" + ("" if high is None else f", at most {high}") + _unit(info)
    if low is not None:
        return f"at least {low}{_unit(info)}" if high is None else f"{low} to {high}{_unit(info)}"
    return "" if high is None else f"at most {high}{_unit(info)}"


def number_text(value: float) -> str:
    """Return a number with all its digits, without an exponent and without .0 at its end."""
    return f"{Decimal(repr(value)).normalize():f}"


def deciding_values(spec: Dataclass, prefix: str = "") -> dict[str, Any]:
    """Return by key the values of a checked dataclass, and of those inside it, that decide bytes as they are.

    Those that are the default are left out, so that a key which is new leaves older datasets as they are.
    """
    found: dict[str, Any] = {}
    for item in fields(spec):
        name, value, info = f"{prefix}{item.name}", getattr(spec, item.name), item.metadata["key"]
        if is_dataclass(value) and not isinstance(value, type):
            found |= deciding_values(value, f"{name}.")
        elif isinstance(value, tuple) and any(is_dataclass(entry) for entry in value):
            for index, entry in enumerate(value):
                found |= deciding_values(entry, f"{name}.{index}.")
        elif info.identity == "value" and value != item.default:
            found[name] = value
    return found


def list_keys(cls: type[Dataclass], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield (key, meaning with default, unit and range) for a dataclass and the dataclasses inside it, in order."""
    hints = get_type_hints(cls)
    for item in fields(cls):
        info: KeyInfo = item.metadata["key"]
        hint, suffix = _unwrap(hints[item.name])
        yield f"{prefix}{item.name}{suffix}", _explain(item, info, hint)
        if isinstance(hint, type) and is_dataclass(hint):
            yield from list_keys(hint, f"{prefix}{item.name}{suffix}.")


def list_leaves(cls: type[Dataclass], prefix: str = "") -> Iterator[tuple[str, KeyInfo]]:
    """Yield (key, what it means) for the keys of a dataclass and of those inside it that hold values themselves."""
    hints = get_type_hints(cls)
    for item in fields(cls):
        hint, suffix = _unwrap(hints[item.name])
        name = f"{prefix}{item.name}{suffix}"
        if isinstance(hint, type) and is_dataclass(hint):
            yield from list_leaves(hint, f"{name}.")
        else:
            yield name, item.metadata["key"]


def fields_on(cls: Any, path: str) -> Iterator[tuple[Any, str, Any]]:
    """Yield for each key on a path the dataclass that has it, its name and the type of its value, while one has it."""
    for name in path.split("."):
        if name.isdigit():  # the place in a list
            continue
        hint = get_type_hints(cls).get(name) if is_dataclass(cls) else None
        if hint is None:
            return
        inside, _ = _unwrap(hint)
        yield cls, name, inside
        cls = inside


def _unwrap(hint: Any) -> tuple[Any, str]:
    if get_origin(hint) in (Union, types.UnionType):
        hint = next(option for option in get_args(hint) if option is not type(None))
    if get_origin(hint) is tuple and get_args(hint)[-1] is Ellipsis:
        return get_args(hint)[0], "[]"
    return hint, ""


def _explain(item: Field[Any], info: KeyInfo, hint: Any) -> str:
    parts = [info.meaning]
    if choices := get_args(hint) if get_origin(hint) is Literal else tuple(info.choices or ()):
        parts.append("one of " + ", ".join(choices))
    if limits := allowed_range(info):
        parts.append(limits)
    elif info.unit:
        parts.append(info.unit)
    if item.default is not MISSING and item.default is not None and not is_dataclass(item.default):
        parts.append(f"default {yaml_line(item.default)}")
    elif item.default is MISSING and item.default_factory is MISSING:
        parts.append("required")
    return "; ".join(parts)


def yaml_line(value: Any) -> str:
    """Return a value as a preset would have it, in one line of YAML."""
    import yaml

    text = yaml.safe_dump(_plain(value), default_flow_style=True, sort_keys=False, allow_unicode=True, width=10**9)
    return text.removesuffix("...\n").rstrip("\n")


def _plain(value: Any) -> Any:
    """Return a value as lists and mappings; of a dataclass what differs from its defaults."""
    if is_dataclass(value):
        given = {item.name: getattr(value, item.name) for item in fields(value)}
        return {item.name: _plain(given[item.name]) for item in fields(value) if given[item.name] != item.default}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


# Reading YAML: plain values out, in bounded time and memory, or one line that names the place in the text.
#
# What is read is what PyYAML's safe loader reads of YAML 1.1, with these differences. Numbers as YAML 1.2 spells them
# (1e-3, -.5) are numbers, and dates are texts. Refused is what has no plain value (!!set, !!omap, !!pairs, !!binary, a
# date by its tag, tags of programs), keys that are no texts or are given twice, numbers that YAML 1.1 and 1.2 read
# differently (010, 1:30), texts that cannot be stored or shown (half a surrogate pair, NUL), anchors inside themselves,
# and what exceeds the limits below.


# Chosen: dozens of times what the largest preset that is shipped needs, and read in about a second.
LARGEST_BYTES = 512 * 1024
LARGEST_VALUES = 20_000  # keys and values, with aliases written out
LARGEST_CHARACTERS = 4 * LARGEST_BYTES  # of all texts, with aliases written out
DEEPEST = 32
LONGEST_NUMBER = 1000  # digits; Python itself turns no more than 4300 into a number

_TAG = "tag:yaml.org,2002:"
_WHOLE = re.compile(r"([-+]?)(0b[01_]*[01][01_]*|0x[0-9a-fA-F_]*[0-9a-fA-F][0-9a-fA-F_]*|[0-9][0-9_]*)")
_NUMBER = re.compile(r"[-+]?(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)(?:[eE][-+]?[0-9]+)?")
_NUMBER_1_2 = re.compile(r"^[-+]?(?:\.[0-9]+(?:[eE][-+]?[0-9]+)?|[0-9]+(?:\.[0-9]*)?[eE][-+]?[0-9]+)$")
_SEXAGESIMAL = re.compile(r"[-+]?[0-9][0-9_]*(?::[0-5]?[0-9])+(?:\.[0-9_]*)?")
_PAIR = re.compile("[\ud800-\udbff][\udc00-\udfff]")  # how JSON escapes a character beyond U+FFFF
_NOT_FINITE = {".inf": math.inf, "+.inf": math.inf, "-.inf": -math.inf, ".nan": math.nan}


def read_yaml(content: str | bytes, file: str | Path, where: str = "") -> Any:
    """Return the value of a YAML document: mappings with texts as keys, lists, texts, numbers, truth values, None.

    content: bytes are UTF-8, or UTF-16 with its mark. file, where: for messages; where the text stands in the file, if
    it is not the file. Nothing in the value is shared, whatever aliases the text has.

    Raises InputError with the line and the column of the first thing that is wrong.
    """
    import yaml

    if len(content) > LARGEST_BYTES:
        problem = f"is larger than {LARGEST_BYTES // 1024} KiB, the most that is read as YAML"
        raise InputError(file, problem, where=where)
    text = content if isinstance(content, str) else _decoded(content, file, where)
    try:
        node = _composed(text)
        return None if node is None else _Values().of(node)
    except yaml.reader.ReaderError as error:
        line, column = _line_and_column(text[: error.position])
        problem = f"the character {error.character:#04x} is not allowed in YAML"
        remedy = "save the file as UTF-8 text" if error.character == 0 else "leave it out"
        raise _error(file, where, (line, column), problem, remedy) from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem = error.problem or error.context or "cannot be read"
        if problem.startswith("but ") and error.context:  # the only problems that are no sentence by themselves
            problem = f"{error.context}, {problem}"
        ours = isinstance(error, yaml.constructor.ConstructorError)
        message = problem if ours else f"is not valid YAML: {_short(problem)}"
        remedy = error.note or ("indent with blanks, not with tabs" if "'\\t'" in problem else "")
        remedy = remedy or ("" if ours else "mend this line, or the one before it")
        raise _error(file, where, mark and (mark.line + 1, mark.column + 1), message, remedy) from error


def _short(problem: str) -> str:
    """Return what PyYAML says of a text, not longer than a line."""
    return problem if len(problem) <= 200 else f"{problem[:200]}..."


def _error(file: str | Path, where: str, at: tuple[int, int] | None, problem: str, remedy: str) -> InputError:
    place = [where] if where else []
    if at is not None:
        place.append(f"line {at[0]}, column {at[1]}")
    return InputError(file, problem, where=": ".join(place), remedy=remedy)


def _line_and_column(before: str) -> tuple[int, int]:
    """Return the line and the column after a text, from 1."""
    lines = re.split(r"\r\n|[\r\n\x85\u2028\u2029]", before)  # the line ends of YAML 1.1
    return len(lines), len(lines[-1]) + 1


def _decoded(content: bytes, file: str | Path, where: str) -> str:
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        at = _line_and_column(content[: error.start].decode(encoding, "replace"))
        raise _error(
            file,
            where,
            at,
            f"is not {'UTF-16' if encoding == 'utf-16' else 'UTF-8'} text",
            "save the file as UTF-8 text",
        ) from error


# --- the text as nodes ---


def _composed(text: str) -> "yaml.Node | None":
    """Return the document of a text, its scalars as they are written. Raises YAMLError."""
    import yaml

    loader = _loader()(text)
    try:
        return loader.get_single_node()
    except (ValueError, OverflowError) as error:  # PyYAML's scanner, of "\UFFFFFFFF" and of a %YAML with many digits
        raise yaml.MarkedYAMLError(None, None, "a number that means nothing", loader.get_mark()) from error


@cache
def _loader() -> "type[yaml.SafeLoader]":
    """Return PyYAML's safe loader, with limits, and with what tells the kinds of plain scalars apart."""
    import yaml

    class Loader(yaml.SafeLoader):
        """Composes nodes of at most LARGEST_VALUES values, DEEPEST deep."""

        def __init__(self, text: str) -> None:
            super().__init__(text)
            self.values = 0
            self.depth = 0

        def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
            """Compose a node after it is counted."""
            event = self.peek_event()
            alias = isinstance(event, yaml.AliasEvent)
            self.values += 1
            self.depth += 1
            if problem := _beyond_limits(self.values, self.depth):
                raise _refused(problem, event.start_mark)
            node = super().compose_node(parent, index)
            if alias and isinstance(node, yaml.CollectionNode) and node.end_mark is None:
                raise _refused(f"*{quoted(event.anchor)} stands inside what it names", event.start_mark)
            self.depth -= 1
            return node

    Loader.add_implicit_resolver(f"{_TAG}float", _NUMBER_1_2, list("-+0123456789."))
    # No key takes a date, and JSON cannot hold one.
    Loader.yaml_implicit_resolvers = {
        letter: [item for item in resolvers if item[0] != f"{_TAG}timestamp"]
        for letter, resolvers in Loader.yaml_implicit_resolvers.items()
    }
    return Loader


def yaml_text(document: dict[str, Any]) -> str:
    """Return a document as YAML that `read_yaml` reads back as the same values: 1e-3 as a text is quoted."""
    import yaml

    class Dumper(yaml.SafeDumper):
        """Quotes what only YAML 1.2 takes for a number."""

    Dumper.add_implicit_resolver(f"{_TAG}float", _NUMBER_1_2, list("-+0123456789."))
    return yaml.dump(document, Dumper=Dumper, sort_keys=False, allow_unicode=True, width=100)


def _beyond_limits(values: int, depth: int) -> str:
    if values > LARGEST_VALUES:
        return f"holds more than {LARGEST_VALUES} values"
    return f"is nested more than {DEEPEST} deep" if depth > DEEPEST else ""


def _refused(problem: str, mark: "yaml.Mark", remedy: str = "") -> "yaml.YAMLError":
    import yaml

    return yaml.constructor.ConstructorError(None, None, problem, mark, remedy)


# --- the nodes as values ---


class _Values:
    """Makes values of nodes, and counts them: an alias counts, each time, as much as what it names."""

    def __init__(self) -> None:
        self._values = 0
        self._characters = 0
        self._depth = 0

    def of(self, node: "yaml.Node") -> Any:
        """Return the value of a node. Raises ConstructorError where it has none, or there are too many."""
        import yaml

        self._values += 1
        self._depth += 1
        if problem := _beyond_limits(self._values, self._depth):
            raise _refused(f"{problem}, with its aliases written out", node.start_mark)
        match node:
            case yaml.ScalarNode():
                self._characters += len(node.value)
                if self._characters > LARGEST_CHARACTERS:
                    problem = f"has more than {LARGEST_CHARACTERS} characters, with its aliases written out"
                    raise _refused(problem, node.start_mark)
                value = _scalar(node)
            case yaml.SequenceNode() if node.tag == f"{_TAG}seq":
                value = [self.of(item) for item in node.value]
            case yaml.MappingNode() if node.tag == f"{_TAG}map":
                value = self._mapping(node)
            case _:
                raise _wrong_tag(node)
        self._depth -= 1
        return value

    def _mapping(self, node: "yaml.MappingNode") -> dict[str, Any]:
        own: dict[str, Any] = {}
        merged: dict[str, Any] | None = None
        for key_node, value_node in node.value:
            if key_node.tag == f"{_TAG}merge":
                if merged is not None:
                    raise _refused("the key '<<' is given twice", key_node.start_mark, "merge a list: <<: [*a, *b]")
                merged = self._merged(value_node)
                continue
            name = self.of(key_node)
            if not isinstance(name, str):
                raise _refused(
                    f"a key is {describe(name)}, but has to be a text", key_node.start_mark, "put it in quotes"
                )
            if name in own:
                raise _refused(f"the key {quoted(name)} is given twice", key_node.start_mark, "keep one of them")
            own[name] = self.of(value_node)
        return own if merged is None else merged | own

    def _merged(self, node: "yaml.Node") -> dict[str, Any]:
        """Return what `<<` brings: a mapping or a list of them, of which the first that has a key decides it."""
        value = self.of(node)
        parts = value if isinstance(value, list) else [value]
        merged: dict[str, Any] = {}
        for part in reversed(parts):
            if not isinstance(part, dict):
                raise _refused("<< merges a mapping, or a list of mappings", node.start_mark)
            merged |= part
        return merged


def _wrong_tag(node: "yaml.Node") -> "yaml.YAMLError":
    tag = node.tag
    name = f"!!{tag.removeprefix(_TAG)}" if tag.startswith(_TAG) else tag
    if node.value in ("=", "<<"):
        return _refused(f"{node.value!r} has a meaning of its own in YAML", node.start_mark, "put it in quotes")
    problem = (
        f"the tag {quoted(name)} does not fit: YAML is read here as mappings, lists, texts, numbers, true and false"
    )
    return _refused(problem, node.start_mark, "leave the tag out")


def _scalar(node: "yaml.ScalarNode") -> Any:
    text: str = node.value
    match node.tag.removeprefix(_TAG):
        case "str":
            text = _PAIR.sub(lambda pair: pair[0].encode("utf-16", "surrogatepass").decode("utf-16"), text)
            if wrong := re.search("[\0\ud800-\udfff]", text):
                problem = f"the text holds the character {ord(wrong[0]):#06x}, which no file name or message can hold"
                raise _refused(problem, node.start_mark, "leave it out")
            return text
        case "null" if text in ("", "~", "null", "Null", "NULL"):
            return None
        case "bool" if text.lower() in _TRUTH:
            return _TRUTH[text.lower()]
        case "int" | "float" as kind:
            return _number(node, kind)
        case "null" | "bool" as kind:
            raise _refused(f"{quoted(text)} is no value of !!{kind}", node.start_mark, "leave the tag out")
        case _:
            raise _wrong_tag(node)


def _number(node: "yaml.ScalarNode", kind: str) -> float:
    """Return an int, or a float. Raises ConstructorError for a text that is neither, or both of two numbers."""
    text: str = node.value
    wanted = "whole number" if kind == "int" else "number"
    if len(text) > LONGEST_NUMBER:
        problem = f"is a number of {len(text)} characters; at most {LONGEST_NUMBER} are read"
        raise _refused(problem, node.start_mark)
    if _SEXAGESIMAL.fullmatch(text):
        problem = f"{quoted(text)} is a number to base 60 in YAML 1.1, and a text in YAML 1.2"
        raise _refused(problem, node.start_mark, "write a plain number, or put the text in quotes")
    digits = text.replace("_", "")
    if kind == "float":
        if text.lower() in _NOT_FINITE:
            return _NOT_FINITE[text.lower()]
        if _NUMBER.fullmatch(text):
            return float(digits)
    elif whole := _WHOLE.fullmatch(text):
        return _whole_number(node, whole[1], digits.lstrip("+-"))
    raise _refused(f"{quoted(text)} is no {wanted}", node.start_mark, "leave the tag out, or put a text in quotes")


def _whole_number(node: "yaml.ScalarNode", sign: str, digits: str) -> int:
    if digits[:2] in ("0b", "0x"):
        number = int(digits[2:], 2 if digits[1] == "b" else 16)
    elif digits[0] == "0" and len(digits) > 1:
        if set(digits) & set("89"):
            raise _refused(f"{quoted(node.value)} is no whole number", node.start_mark, "leave out the zeros before it")
        number = int(digits)
        if number != (octal := int(digits, 8)):
            problem = f"{quoted(node.value)} is {quoted(octal)} in YAML 1.1, and {quoted(number)} in YAML 1.2"
            raise _refused(problem, node.start_mark, "leave out the zeros before it, or put a text in quotes")
    else:
        number = int(digits)
    return -number if sign == "-" else number
