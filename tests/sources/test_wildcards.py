# SPDX-License-Identifier: GPL-3.0-or-later
"""What wildcards matched: beside fnmatch, and in bounded time."""

from fnmatch import fnmatchcase

import numpy as np
import pytest
from calls import calls_made
from worlds import write_world

from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan
from noisy_world.sources.scene_kinds import matched_parts

PATTERNS = [
    ("rooms/*.ply", "rooms/hall.ply", ("hall",)),
    ("room?_*/mesh.ply", "room1_b/mesh.ply", ("1", "b")),
    ("*_*.ply", "a_b_c.ply", ("a", "b_c")),
    ("room[0-2].ply", "room1.ply", ("1",)),
    ("[!x]*/y", "abc/y", ("a", "bc")),
    ("**/mesh.ply", "a/b/mesh.ply", ("mesh",)),
    ("[].ply", "[].ply", ()),
]


@pytest.mark.parametrize(("pattern", "path", "parts"), PATTERNS)
def test_parts_by_hand(pattern, path, parts):
    assert matched_parts(pattern, path) == parts


def test_what_fnmatch_accepts_is_put_together_again_from_its_parts():
    rng = np.random.default_rng(4)
    tried = 0
    while tried < 300:
        pattern = "x" + "".join(rng.choice(list("ab*?[]!-_"), rng.integers(1, 8)))
        name = "x" + "".join(rng.choice(list("ab_"), rng.integers(1, 7)))
        if not fnmatchcase(name, pattern) or "[" in pattern:
            continue
        tried += 1
        parts = matched_parts(pattern, name)
        rest = pattern.replace("**", "*").replace("**", "*").replace("**", "*")
        for part in parts:
            at = min(place for letter in "*?" if (place := rest.find(letter)) >= 0)
            rest = rest[:at] + part.replace("*", "\0") + rest[at + 1 :]
        assert rest == name


def test_a_pattern_of_many_stars_takes_no_long_time():
    pattern, name = "*" + "a*" * 60 + "[bc]", "a" * 240 + "b"
    assert calls_made(matched_parts, pattern, name) < 1_000_000


def test_a_file_whose_own_name_has_wildcards_is_meant_itself(tmp_path):
    preset = write_world(tmp_path, scenes=[{"name": "box", "mesh": "scan[1].ply", "trajectory": "traj.txt"}])
    (tmp_path / "mesh.ply").rename(tmp_path / "scan[1].ply")
    (scene,) = make_plan(read_preset(preset)).scenes
    assert scene.source.location == str(tmp_path / "scan[1].ply")
