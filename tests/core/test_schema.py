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


def test_words_without_quotes():
    assert parsed("lamp: on").lamp == parsed("lamp: 'on'").lamp == "on"
    assert parsed("lamp: Off").lamp == "off"
    assert parsed("fan: yes").fan == "yes"
    assert parsed("{name: hall, blend: hall.blend, compositor: off}", BlendKeys).compositor == "off"


@cases("text", ["both: off", "fan: no", "lamp: 0", "{name: a, blend: a, compositor: on}"])
def test_what_no_choice_is_meant_by_is_refused(text):
    refused(parsed, text, BlendKeys if "name" in text else Switches, names="but has to be one of ")
