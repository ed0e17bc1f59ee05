# SPDX-License-Identifier: GPL-3.0-or-later
"""Choices that YAML 1.1 reads as truth values, where they stand without quotes."""

from dataclasses import dataclass
from typing import Literal

from refusals import refused
from cases import cases

from noisy_world.core.schema import Choice, ConfigPath, key, parse
from noisy_world.core.schema import read_yaml
from noisy_world.sources.blend import BlendKeys


@dataclass(frozen=True)
class Switches:
    lamp: Literal["on", "off", "dim"] = key("a lamp", default="dim")
    fan: str = key("a fan", default="slow", choices={name: Choice(name, "") for name in ("yes", "slow")})
    both: Literal["off", "no"] = key("both words are false", default="no")


def parsed(text, cls=Switches):
    return parse(cls, read_yaml(text, "p.yaml"), ConfigPath("p.yaml"))


@dataclass(frozen=True)
class Bounded:
    share: float = key("a share", default=0.5, minimum=0, maximum=1)
    count: int = key("how many", default=1, minimum=1, maximum=5)
    length_m: float = key("a length", default=1.0, above=0)


@cases("text", ["share: 0", "share: 1", "count: 1", "count: 5", "length_m: 1.0e-300"])
def test_least_and_most_are_in_a_range(text):
    name, value = text.split(": ")
    assert getattr(parsed(text, Bounded), name) == float(value)


@cases("text", ["share: -1.0e-9", "share: 1.000000001", "count: 0", "count: 6", "length_m: 0"])
def test_what_is_beyond_a_range_is_refused(text):
    refused(parsed, text, Bounded, names=(text.split(":")[0], "out of range"))


def test_words_without_quotes():
    assert parsed("lamp: on").lamp == parsed("lamp: 'on'").lamp == "on"
    assert parsed("lamp: Off").lamp == "off"
    assert parsed("fan: yes").fan == "yes"
    assert parsed("{name: hall, blend: hall.blend, compositor: off}", BlendKeys).compositor == "off"


@cases("text", ["both: off", "fan: no", "lamp: 0", "{name: a, blend: a, compositor: on}"])
def test_what_no_choice_is_meant_by_is_refused(text):
    refused(parsed, text, BlendKeys if "name" in text else Switches, names="but has to be one of ")
