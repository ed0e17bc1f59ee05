# SPDX-License-Identifier: GPL-3.0-or-later
"""YAML: the values that PyYAML's safe loader reads, or one line with the place, soon and in little memory."""

import json
import resource
import time

from cases import cases
import pytest
from refusals import refused
import yaml

from noisy_world.core.errors import InputError
from noisy_world.core.schema import LARGEST_BYTES, LARGEST_VALUES, read_yaml

LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12)
)
MERGED_LAUGHS = "a0: &a0 {k: 1}\n" + "".join(
    f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}\n" for k in range(1, 12)
)
NESTED_ALIASES = "a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}]\n" for k in range(1, 200))


@cases(
    "text",
    [
        "",
        "# nothing",
        "a: 1\nb: [2, 3.5, -0.0, .5, 1., +7]\n",
        "{a: yes, b: No, c: ON, d: off, e: true, f: FALSE, g: y, h: n}",
        "[null, ~, Null, '', 'null', NULL, nUll]",
        "[0b101, 0x1F, -0xf_f, 1_000, 0, -0, 00, 0_7, 1_0.5_0, 08, 0o17, 0x, 0b, 1e, .e1, ._5, 1_e5, _1]",
        "[1.5e+3, 1.e-2, .5e+1, 6.02e+23, 1.5E-7]",
        "[.inf, -.INF, +.Inf]",
        "a: !!str 1\nb: !!int '12'\nc: !!float 3\nd: !!float '1_0'\ne: !!bool 'YES'\nf: !!null ''\ng: ! 5\n",
        "a: &x {b: 1, c: [1, 2]}\nd: *x\ne: {<<: *x, b: 3}\nf: {<<: [{b: 9}, *x], z: 1}\n",
        "a: &x {<<: &y {k: 1, l: 2}, l: 3}\nb: {<<: *x, m: *y}\nc: *x\n",
        "'<<': 1\n",
        'a: |\n  two\n  lines\nb: >-\n  one\n  line\nc: "\\u00e9\\t\\x41"\n',
        "\ufeffa: 1\n",
        "%YAML 1.1\n---\na: 1\n...\n",
        "? a\n: b\n",
        "a:\n- b\n-   c:\n      d\n",
        "!!map {a: !!seq [1]}",
        "a: käse\nb: 日本\nc: 😀\n",
        "- [a, b\n   , c]\n- {d, e}\n",
    ],
)
def test_values_are_those_of_the_safe_loader(text):
    expected = yaml.safe_load(text)
    assert repr(read_yaml(text, "a.yaml")) == repr(expected)  # repr tells 1 from True and from 1.0
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        plain = text.removeprefix("\ufeff")
        assert repr(read_yaml(plain.encode(encoding), "a.yaml")) == repr(expected)


def test_the_differences_from_the_safe_loader():
    assert read_yaml("[1e-3, 1E5, -.5e3, 1.e2, +.5, -.5]", "a") == [1e-3, 1e5, -500.0, 100.0, 0.5, -0.5]
    assert read_yaml("[2001-01-01, 2001-99-99]", "a") == ["2001-01-01", "2001-99-99"]


@cases("character", ["\U0001f600", "\U00010000", "\U0010ffff"])
def test_json_with_surrogate_pairs_is_read_as_json_means_it(character):
    document = {f"room {character}": [character * 2, f"a{character}b", "c"]}
    assert read_yaml(json.dumps(document), "a") == document
    for backwards in (r'"\ude00\ud83d"', r'"\ud83d\ud83d\ude00"', r'"\ud83d \ude00"'):
        with pytest.raises(InputError, match=r"0xd83d|0xde00"):
            read_yaml(backwards, "a")


def test_aliases_are_values_of_their_own():
    value = read_yaml("a: &x {b: [1]}\nc: *x\n", "a.yaml")
    value["c"]["b"].append(2)
    assert value["a"] == {"b": [1]}


@cases(
    ("text", "words"),
    [
        ("a: !!int x", "line 1, column 4: 'x' is no whole number"),
        ("a:\n  - !!float x", "line 2, column 5: 'x' is no number"),
        ("a: !!int 1.5", "no whole number"),
        ("a: !!float 0x10", "no number"),
        ("a: !!bool x", "no value of !!bool"),
        ("a: !!null x", "no value of !!null"),
        ("a: 0b_", "'0b_' is no whole number"),
        ("a: 0x__", "'0x__' is no whole number"),
        ("a: 010", "'010' is 8 in YAML 1.1, and 10 in YAML 1.2"),
        ("a: !!int 09", "no whole number"),
        ("a: 1:30", "to base 60"),
        ("a: 1:30.5", "to base 60"),
        ("a: 1:" + "59:" * 30_000 + "1", "at most 1000 are read"),
        ("a: " + "9" * 5000, "a number of 5000 characters"),
        ("a: 0x" + "f" * 5000, "a number of 5002 characters"),
        ("a: !!map [1]", "line 1, column 4: the tag '!!map' does not fit"),
        ("a: !!str [1]", "the tag '!!str'"),
        ("a: !!seq {}", "the tag '!!seq'"),
        ("a: !!int {=: 5}", "the tag '!!int'"),
        ("a: !!set {b, c}", "the tag '!!set'"),
        ("a: !!pairs [b: 1]", "the tag '!!pairs'"),
        ("a: !!omap [b: 1]", "the tag '!!omap'"),
        ("a: !!omap b", "the tag '!!omap'"),
        ("a: !!binary aGk=", "the tag '!!binary'"),
        ("a: !!timestamp 2001-01-01", "the tag '!!timestamp'"),
        ("a: !!python/object/apply:os.system ['true']", "'!!python/object/apply:os.system'"),
        ("a: !own 1", "the tag '!own'"),
        ("a: =", "'=' has a meaning of its own"),
        ("a: <<", "'<<' has a meaning of its own"),
        ("{[a]: b}", "line 1, column 2: a key is a list"),
        ("? {a: b}\n: c", "a key is a mapping"),
        ("1: 2", "a key is the number 1"),
        ("on: 2", "a key is the truth value true, but has to be a text; put it in quotes"),
        ("~: 2", "a key is empty"),
        ("a: 1\nb: 2\na: 3", "line 3, column 1: the key 'a' is given twice"),
        ('a: 1\n"\\x61": 3', "line 2, column 1: the key 'a' is given twice"),
        ("<<: 3", "<< merges a mapping"),
        ("<<: [{a: 1}, 2]", "<< merges a mapping"),
        ("<<: {a: 1}\n<<: {b: 1}", "line 2, column 1: the key '<<' is given twice"),
        ("a: *b", "line 1, column 4: is not valid YAML: found undefined alias 'b'"),
        ("a: &b 1\nc: &b 2", "line 2, column 4: is not valid YAML: second occurrence"),
        ("a: &a [*a]", "line 1, column 8: *'a' stands inside what it names"),
        ("&a {b: {c: *a}}", "*'a' stands inside"),
        ("&a {<<: *a}", "*'a' stands inside"),
        (LAUGHS, f"more than {LARGEST_VALUES} values, with its aliases written out"),
        (MERGED_LAUGHS, f"more than {LARGEST_VALUES} values, with its aliases written out"),
        (NESTED_ALIASES, "nested more than 32 deep, with its aliases written out"),
        (f"a: &a {'x' * 200_000}\nb: [{'*a, ' * 900}]", "characters, with its aliases written out"),
        ("[" * 5000, "line 1, column 33: is nested more than 32 deep"),
        ("a: " + "{a: " * 5000, "nested more than 32 deep"),
        ("- " * 50_000, "nested more than 32 deep"),
        ("? " * 50_000, "nested more than 32 deep"),
        ("[" + "0," * 100_000 + "]", f"holds more than {LARGEST_VALUES} values"),
        ("a" * (LARGEST_BYTES + 1), "is larger than 512 KiB"),
        ("a:\n\t- b", "line 2, column 1: is not valid YAML: found character '\\t' that cannot start any token; indent"),
        ("a: b\0c", "line 1, column 5: the character 0x00 is not allowed in YAML"),
        ("a: 1\nb: \x07", "line 2, column 4: the character 0x07"),
        ("a: \ud800", "line 1, column 4: the character 0xd800"),
        ('a: "\\ud800"', "line 1, column 4: the text holds the character 0xd800"),
        ('a: "b\\0"', "the text holds the character 0x0000"),
        ('a: "\\UFFFFFFFF"', "line 1, column 7: is not valid YAML"),
        ("%YAML " + "1" * 5000 + ".1\n---\na: 1", "line 1, column 7: is not valid YAML"),
        ("%YAML 2.0\n---\na: 1", "is not valid YAML: found incompatible YAML document"),
        ("a: 1\n---\nb: 2", "line 2, column 1: is not valid YAML: expected a single document"),
        ("a: [1", "line 1, column 6: is not valid YAML"),
        (b"a: 1\nb: \xff\n", "line 2, column 4: is not UTF-8 text"),
        ("käse: 1\nb: ä".encode("latin-1"), "line 1, column 2: is not UTF-8 text"),
        ("a: 1".encode("utf-16") + b"b", "is not UTF-16 text"),
        (
            "a: 1".encode("utf-16-le"),
            "line 1, column 2: the character 0x00 is not allowed in YAML; save the file as UTF-8",
        ),
        ("a: 1".encode("utf-32"), "the character 0x00"),
        (b"\x1f\x8b\x08\x00 a gzip", "is not UTF-8 text"),
    ],
)
def test_what_is_refused(text, words):
    began = time.process_time()
    message = refused(read_yaml, text, "a.yaml", names=("a.yaml: ", words))
    assert time.process_time() - began < 5  # a second, of this process alone
    assert len(message) < 400


def test_little_memory_is_taken():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for text in (LAUGHS, MERGED_LAUGHS, "[" * 100_000, "{a: 1, " * 70_000):
        with pytest.raises(InputError):
            read_yaml(text, "a.yaml")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200 * 1024


def test_where_the_text_stands():
    refused(read_yaml, "[", "a.yaml", "--set b=[", names=("a.yaml: --set b=[: line 1, column 2: ", "YAML"))
