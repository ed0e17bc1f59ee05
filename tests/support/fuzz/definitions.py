# SPDX-License-Identifier: GPL-3.0-or-later
"""Definitions of systems, those that are shipped and one with every key, changed by structure."""

import functools

import yaml
from fuzz.mutation import pick
from fuzz.structure import as_yaml, changed, note

from noisy_world.evaluate import systems
from noisy_world.evaluate.systems import PLACEHOLDERS, read_system
from noisy_world.trajectories.formats import TRAJECTORY_FORMATS as FORMATS
from pathlib import Path

WORDS = (
    *(f"{{{name}}}" for name in PLACEHOLDERS),
    *FORMATS,
    "{",
    "{x}",
    "colour",
    "depth",
    "A=B",
    "A",
    "tum",
    "euroc",
    "index",
)
FULL = {
    "name": "own",
    "about": "a system",
    "command": ["{python}", "run.py", "{frames}", "{sequence}", "{out}"],
    "reads": {"modalities": ["colour", "depth"], "layouts": ["tum", "replica"]},
    "writes": {"file": "run*/poses.txt", "format": "tum", "axes": "opencv", "direction": "c2w", "stamp_unit": "s"},
    "environment": "slam",
    "variables": ["A=B"],
    "threads": 2,
    "time_limit": {"start_s": 10, "frame_s": 0.5},
    "map_arguments": ["--map", "{out}/map.ply"],
    "versions": ["{python}", "--version"],
    "remedy": "install it",
    "gpu": False,
}


@functools.cache
def _shipped():
    folder = Path(systems.__file__).parent
    return [yaml.safe_load(path.read_text()) for path in sorted(folder.rglob("*.yaml"))]


def write(folder, rng):
    """Write system.yaml."""
    shipped = _shipped()
    document = FULL if rng.integers(2) or not shipped else pick(rng, shipped)
    tree, told = changed(document, rng, words=WORDS)
    (folder / "system.yaml").write_bytes(as_yaml(tree, flow=bool(rng.integers(2))))
    note(folder, told)


def read(folder):
    """Read the definition, and what of it decides results."""
    system = read_system(folder / "system.yaml")
    assert len(system.digest) == 64
    assert system.time_limit.of(1000) > 0
    return system


def differs(folder, system):
    """Say which text of the definition was read otherwise than PyYAML does."""
    document = yaml.safe_load((folder / "system.yaml").read_bytes())
    for name in ("name", "about", "remedy", "threads", "gpu"):
        if name in document and document[name] is not None and document[name] != getattr(system, name):
            return f"{name} is {getattr(system, name)!r}, but {document[name]!r} in the file"
    return "" if list(system.command) == document["command"] else f"command is {system.command}"
