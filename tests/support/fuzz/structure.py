# SPDX-License-Identifier: GPL-3.0-or-later
"""Mutations of structure: a value in a tree of mappings, lists and plain values is changed, and the rest stays sound.

A tree is written as JSON, as YAML or, where it is a list of rows, as a table; what these cannot spell (NaN, half a
letter, a key that stands there twice) is kept in the tree as `Raw` and `Key`, and spelled as it is.
"""

import copy
import functools
import json
import tempfile
from dataclasses import dataclass
from pathlib import Path

import yaml
from fuzz.mutation import pick

CHANGES = (0, 1, 1, 1, 1, 1, 2, 2, 3)
"""How many changes a case has. Without one, the input is sound, and has to be accepted."""


@dataclass(frozen=True)
class Raw:
    """Bytes that stand in a file as they are."""

    data: bytes


class Key(str):
    """A key of a mapping that equals no other, so that a mapping may hold the same text twice."""

    __slots__ = ()
    __hash__ = object.__hash__

    def __eq__(self, other):
        return self is other


PLAIN = (
    None, True, False, 0, 1, -1, 2, 3, 0.5, -0.5, 1.0, "", " ", "x", "0", "1", "null", [], {}, [[]], [None], {"": None},
    [1, 2, 3], {"a": 1}, [0.0] * 16, "é", "😀", "a b", "a,b", "\t", "a\nb", "\x00", "\x1b[31m", "\u2028", "=1+1",
    "<b>&",
)  # fmt: skip
HUGE = (
    -128, 127, 128, 255, 256, -32768, 32767, 32768, 65535, 65536, 2**24 + 1, 2**31 - 1, 2**31, -(2**31), 2**32 - 1,
    2**32, 2**53 + 1, 2**63 - 1, 2**63, -(2**63), 2**64, 10**30, 10**400, 1e-320, 1e-9, 1e15, 1e38, 1e39, 1e300, -1e300,
)  # fmt: skip
PATHS = (
    "../x", "../../outside/kept.txt", "..", ".", "/", "//", "/etc/passwd", "/dev/null", "/dev/zero",
    "/proc/self/mem", "x" * 300,
    "a/" * 2000 + "a", "a" * 5000, "~", "~nobody-here/x", "C:\\x", "\\\\host\\x", "a\x00b", "%00", "%2e%2e/x", "*",
    "**",
    "[", "?", "file:///etc/passwd", "s3://bucket/x", "con", "-rf", "$HOME", "{x}", "{", "x/..", "./x", "x/",
)  # fmt: skip


def raws(*contents):
    """Return contents that stand in a file as they are."""
    return tuple(map(Raw, contents))


RAWS = raws(
    b"NaN", b"nan", b"Infinity", b"-inf", b".nan", b"1e999", b"-1e999", b"9" * 5000, b"0." + b"0" * 4000 + b"1",
    b'"\xff\xfe"', b"\xc3\x28", b'"\\ud800"', b'"\xed\xa0\x80"', b"'a'", b"0x10", b"010", b"1_0", b"+1", b".5", b"1.",
    b"[" * 3000 + b"]" * 3000, b'{"a":' * 2000 + b"1" + b"}" * 2000, b"{", b"]", b"", b",", b'"', b"True", b"-",
    b"1e5", b"\xef\xbb\xbf1", b"\x00", b"# 1", b"\xef\xbc\x91",
)  # fmt: skip
OF_TABLES = raws(
    b"nan", b"inf", b"-inf", b"1e999", b"\xff\xfe", b"\x00", b"9" * 5000, b"0x10", b"\r", b"1_0", b"1e400", b"\x1a",
    b"#",
    b"1,5", b"\xef\xbb\xbf", b'"', b"a,b", b"'",
)  # fmt: skip
"""What may stand in a table where a number has to be."""
LONG = 40  # entries that a list is repeated to, where it is


def places(tree):
    """Return every (container, key) of a tree, from the outside in."""
    found, waiting = [], [tree]
    while waiting:
        node = waiting.pop(0)
        for key, value in list(node.items() if isinstance(node, dict) else enumerate(node)):
            found.append((node, key))
            if isinstance(value, (dict, list)):
                waiting.append(value)
    return found


def changed(tree, rng, *, raws=RAWS, words=()):
    """Return a tree after a few changes, and the changes in words. words: texts that mean something here."""
    holder = {"": copy.deepcopy(tree)}
    told = []
    for _ in range(pick(rng, CHANGES)):
        inside = places(holder)[1:]
        outer = [place for place in inside if isinstance(place[0][place[1]], (dict, list))]
        if not inside:
            break
        container, key = pick(rng, outer if rng.integers(4) == 0 and outer else inside)
        told.append(f"{key!s:.40}: {_change(container, key, rng, raws, words)}")
    return holder[""], told


def _change(container, key, rng, raws, words):
    """Change what is at a place of a tree; return how."""
    value = container[key]
    options = [_other_value, _other_value, _other_value, _nested, _removed, _doubled]
    if isinstance(container, dict):
        options += [_renamed, _doubled_key]
    if isinstance(value, list):
        options += [_emptied, _repeated, _reordered, _cut]
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        options += [_near, _near, _near]
    change = pick(rng, options)
    return change(container, key, rng, (raws, words)) or change.__name__.strip("_")


def _other_value(container, key, rng, choices):
    raws, words = choices
    kinds = [PLAIN, PLAIN, HUGE, PATHS, *([raws] if raws else []), *([words] * 2 if words else [])]
    container[key] = copy.deepcopy(pick(rng, pick(rng, kinds)))
    return f"becomes {container[key]!r:.60}"


def _near(container, key, rng, _choices):
    """Replace a number by one that is near it, or of its kind."""
    value = container[key]
    others = (value + 1, value - 1, -value, value * 2, value + 0.5, float(value), str(value), [value], value * 1000)
    container[key] = pick(rng, others)
    return f"becomes {container[key]!r:.60}"


def _nested(container, key, rng, _choices):
    value = container[key]
    container[key] = pick(rng, ([value], {"a": value}, [[value]], {str(key): value}, [value, value]))


def _removed(container, key, _rng, _choices):
    del container[key]


def _doubled(container, key, rng, _choices):
    """Put a value at another place, too."""
    holders = [container] + [value for value in _values(container) if isinstance(value, (dict, list))]
    holder = pick(rng, holders)
    value = copy.deepcopy(container[key])
    if isinstance(holder, list):
        holder.insert(int(rng.integers(len(holder) + 1)), value)
    else:
        holder[pick(rng, list(holder)) if holder else "x"] = value


def _values(container):
    return list(container.values() if isinstance(container, dict) else container)


def _renamed(container, key, rng, choices):
    words = choices[1]
    names = [str(key).upper(), f"{key}s", f" {key}", "", "x", "a" * 300, "../x", "é", "0", "\x00", *words[:8]]
    _set_key(container, key, str(pick(rng, names)))


def _set_key(container, key, name):
    """Rename a key where it stands."""
    items = [(name if each is key else each, value) for each, value in container.items()]
    container.clear()
    container.update(items)


def _doubled_key(container, key, rng, choices):
    """Let a key stand there twice, with the same value or another."""
    again = Key(key)
    container[again] = copy.deepcopy(container[key])
    if rng.integers(2):
        _other_value(container, again, rng, choices)


def _emptied(container, key, _rng, _choices):
    container[key] = []


def _repeated(container, key, rng, _choices):
    value = container[key]
    container[key] = copy.deepcopy(value * 2 if rng.integers(2) else (value * LONG)[:LONG])


def _reordered(container, key, rng, _choices):
    value = container[key]
    container[key] = [value[k] for k in rng.permutation(len(value))]


def _cut(container, key, rng, _choices):
    value = container[key]
    del value[int(rng.integers(len(value) + 1)) :]


def text_changed(path, rng, *, words=()):
    """Change a file by its structure, as JSON, lines of JSON, YAML or a table; return the changes."""
    text = path.read_text(encoding="utf-8", errors="replace")
    options = {}
    match path.suffix:
        case ".json":
            parse, write = json.loads, lambda tree: as_json(tree, indent=2)
        case ".jsonl":
            parse, write = (lambda lines: [json.loads(line) for line in lines.splitlines()]), as_lines
        case ".yaml":
            flow, head = bool(rng.integers(2)), b"%YAML 1.2\n---\n" * text.startswith("%")
            parse, write = yaml.safe_load, lambda tree: head + as_yaml(tree, flow=flow)
        case suffix:
            separator = "," if suffix == ".csv" else " = " if path.name == "info.txt" else " "
            parse, write = (
                lambda lines: [line.split(separator) for line in lines.splitlines()],
                lambda tree: as_table(tree, separator),
            )
            options = {"raws": OF_TABLES}
    try:
        tree = parse(text)
    except (ValueError, RecursionError, yaml.YAMLError):  # changed before
        return [f"{path.name}: is no tree any more"]
    tree, told = changed(tree, rng, words=words, **options)
    if told:
        path.write_bytes(write(tree))
    return [f"{path.name}: {each}" for each in told]


# --- writing ---


def as_json(tree, indent=None):
    """Return a tree as the bytes of a JSON text."""
    held = []
    text = json.dumps(_spelled(tree, held), indent=indent)
    return _filled(text.encode("utf-8", "surrogatepass"), held)


def as_lines(rows):
    """Return the rows of a tree as JSON lines; what is no list is one line."""
    return b"".join(as_json(row) + b"\n" for row in (rows if isinstance(rows, list) else [rows]))


def as_yaml(tree, *, flow):
    """Return a tree as YAML: as JSON, which YAML holds, or in blocks."""
    if flow or _has_key_twice(tree):
        return as_json(tree, indent=1)
    held = []
    spelled = _spelled(tree, held)
    text = yaml.dump(spelled, Dumper=_Dumper, allow_unicode=True, sort_keys=False)
    return _filled(text.encode("utf-8", "surrogatepass"), held, quotes=("", '"', "'"))


class _Dumper(yaml.SafeDumper):
    """Writes no anchors: what is given twice is written twice."""

    def ignore_aliases(self, data):
        return True


def as_table(rows, separator=" ", end="\n"):
    """Return rows of cells as a text; what is no list of lists is written as one cell."""
    lines = [row if isinstance(row, list) else [row] for row in (rows if isinstance(rows, list) else [[rows]])]
    return b"".join(separator.encode().join(map(as_cell, line)) + end.encode() for line in lines)


def as_cell(value):
    """Return a value as the bytes of a cell, or of a word in any other text."""
    match value:
        case Raw():
            return value.data
        case None:
            return b""
        case bytes():
            return value
        case str():
            return value.encode("utf-8", "surrogatepass")
        case float() | int():
            return _number(value).encode()
        case list():
            return b" ".join(map(as_cell, value))
        case dict():
            return b" ".join(as_cell(key) + b" " + as_cell(each) for key, each in value.items())
    raise TypeError(f"{value!r} is no cell")


def _number(value):
    """Return a number as text; Python converts no integer of thousands of digits, and JSON's 1.0 is 1.0 here."""
    return repr(value) if isinstance(value, (bool, float)) else format(value, "d")


def _spelled(tree, held):
    """Return a tree with texts in place of what JSON cannot spell."""
    match tree:
        case Raw():
            held.append(tree.data)
            return _mark(len(held) - 1)
        case dict():
            return {key if isinstance(key, Key) else str(key): _spelled(each, held) for key, each in tree.items()}
        case list() | tuple():
            return [_spelled(each, held) for each in tree]
    return tree


def _mark(number):
    return f"(raw {number} here)"


def _filled(data, held, quotes=('"',)):
    for number, raw in enumerate(held):
        mark = _mark(number)
        for quote in sorted(quotes, key=len, reverse=True):
            data = data.replace(f"{quote}{mark}{quote}".encode(), raw)
    return data


def _has_key_twice(tree):
    if isinstance(tree, dict):
        return any(isinstance(key, Key) for key in tree) or any(map(_has_key_twice, tree.values()))
    return isinstance(tree, (list, tuple)) and any(map(_has_key_twice, tree))


def whole(value, low, high):
    """Return a value as a whole number that a field of a binary file holds: what does not fit is wrapped."""
    span = high - low + 1
    try:
        number = int(value) if isinstance(value, (int, float, str)) else len(value) if value is not None else 0
    except (ValueError, OverflowError, TypeError):
        number = high
    return (number - low) % span + low


def beside(folder):
    """Put beside an input what nothing may touch."""
    (folder / "outside").mkdir()
    (folder / "outside/kept.txt").write_text("somebody's")


@functools.cache
def kept(name):
    """Return a folder that lasts as long as this process, for what is made once."""
    keeper = tempfile.TemporaryDirectory(prefix=f"fuzz-{name}-")
    _KEPT.append(keeper)
    return Path(keeper.name)


_KEPT = []


def note(folder, told):
    """Keep beside a case what was changed; an empty list says that the input is sound."""
    (folder / NOTE).write_text(json.dumps(told))


def is_sound(folder):
    """Tell whether nothing was changed in a case's input."""
    path = folder / NOTE
    return path.is_file() and json.loads(path.read_text()) == []


NOTE = "changes.json"
