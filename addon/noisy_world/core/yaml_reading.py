# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading YAML: plain values out, in bounded time and memory, or one line that names the place in the text.

What is read is what PyYAML's safe loader reads of YAML 1.1, with these differences. Numbers as YAML 1.2 spells them
(1e-3, -.5) are numbers, and dates are texts. Refused is what has no plain value (!!set, !!omap, !!pairs, !!binary, a
date by its tag, tags of programs), keys that are no texts or are given twice, numbers that YAML 1.1 and 1.2 read
differently (010, 1:30), texts that cannot be stored or shown (half a surrogate pair, NUL), anchors inside themselves,
and what exceeds the limits below.
"""

import math
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import InputError
from .schema import describe, shown

if TYPE_CHECKING:
    import yaml

# Chosen: dozens of times what the largest preset that is shipped needs, and read in about a second.
LARGEST_BYTES = 512 * 1024
LARGEST_VALUES = 20_000  # keys and values, with aliases written out
LARGEST_CHARACTERS = 4 * LARGEST_BYTES  # of all texts, with aliases written out
DEEPEST = 32
LONGEST_NUMBER = 1000  # digits; Python itself turns no more than 4300 into a number

_TAG = "tag:yaml.org,2002:"
_TRUTH = {"yes": True, "no": False, "true": True, "false": False, "on": True, "off": False}
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
                raise _refused(f"*{shown(event.anchor)} stands inside what it names", event.start_mark)
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
                raise _refused(f"the key {shown(name)} is given twice", key_node.start_mark, "keep one of them")
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
        f"the tag {shown(name)} does not fit: YAML is read here as mappings, lists, texts, numbers, true and false"
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
            raise _refused(f"{shown(text)} is no value of !!{kind}", node.start_mark, "leave the tag out")
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
        problem = f"{shown(text)} is a number to base 60 in YAML 1.1, and a text in YAML 1.2"
        raise _refused(problem, node.start_mark, "write a plain number, or put the text in quotes")
    digits = text.replace("_", "")
    if kind == "float":
        if text.lower() in _NOT_FINITE:
            return _NOT_FINITE[text.lower()]
        if _NUMBER.fullmatch(text):
            return float(digits)
    elif whole := _WHOLE.fullmatch(text):
        return _whole_number(node, whole[1], digits.lstrip("+-"))
    raise _refused(f"{shown(text)} is no {wanted}", node.start_mark, "leave the tag out, or put a text in quotes")


def _whole_number(node: "yaml.ScalarNode", sign: str, digits: str) -> int:
    if digits[:2] in ("0b", "0x"):
        number = int(digits[2:], 2 if digits[1] == "b" else 16)
    elif digits[0] == "0" and len(digits) > 1:
        if set(digits) & set("89"):
            raise _refused(f"{shown(node.value)} is no whole number", node.start_mark, "leave out the zeros before it")
        number = int(digits)
        if number != (octal := int(digits, 8)):
            problem = f"{shown(node.value)} is {shown(octal)} in YAML 1.1, and {shown(number)} in YAML 1.2"
            raise _refused(problem, node.start_mark, "leave out the zeros before it, or put a text in quotes")
    else:
        number = int(digits)
    return -number if sign == "-" else number
