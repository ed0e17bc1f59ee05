# SPDX-License-Identifier: GPL-3.0-or-later
"""Documents written as YAML keep their texts, for our reader and for PyYAML's own."""

import yaml

from noisy_world.core.schema import read_yaml, yaml_text

TEXTS = [
    "1e3",
    "1e-3",
    ".5",
    "-.5e2",
    "1.e5",
    "010",
    "1:30",
    "0x1F",
    "yes",
    "null",
    "~",
    "2026-11-22",
    "",
    "fog",
    "a: b",
    "é",
]


def test_texts_that_look_like_numbers_come_back_as_texts():
    document = {"names": TEXTS, "numbers": [1e-3, 1e300, 5, -0.5, 1e16], "truth": [True, None]}
    text = yaml_text(document)
    for read in (read_yaml(text, "preset.yaml"), yaml.safe_load(text)):
        assert read["names"] == TEXTS
        assert read["truth"] == document["truth"]
    numbers = read_yaml(text, "preset.yaml")["numbers"]
    assert numbers == document["numbers"]
    assert not any(isinstance(number, str) for number in numbers)
