# SPDX-License-Identifier: GPL-3.0-or-later
"""What --set changes in a preset's document."""

from pathlib import Path
from typing import Any

from ..errors import InputError
from ..schema import ConfigPath, shown
from ..yaml_reading import DEEPEST, read_yaml
from .scene_keys import BodySpec, TrajectorySpec

BARE = {"trajectory": TrajectorySpec.SHORTHAND, "body": BodySpec.SHORTHAND}
"""What a bare text stands for: so trajectory.every can be set where the preset names only a file."""


def override(document: dict[str, Any], text: str, path: Path) -> None:
    """Change a document by a text `key.path=value`, the value in YAML, entries of lists by their number.

    path: of the preset, for messages. Raises InputError.
    """
    name, equals, value_text = text.partition("=")
    keys = name.strip().split(".")
    message = f"--set {text if text.isprintable() and len(text) <= 100 else shown(text)}"
    if not equals or not all(keys):
        raise InputError(path, f"{message}: has to be key.path=value")
    if len(keys) > DEEPEST:
        raise InputError(path, f"{message}: leads more than {DEEPEST} deep")
    value = read_yaml(value_text, path, message)
    node: Any = document
    where = ConfigPath(path)
    for index, step in enumerate(keys):
        where = where.at(step)
        last = index == len(keys) - 1
        if isinstance(node, list):
            entry = _entry(node, step, where)
            if last:
                node[entry] = value
            else:
                node = node[entry]
        elif not isinstance(node, dict):
            raise where.error("--set: leads into a value that has no keys")
        elif last:
            node[step] = value
        else:
            if not isinstance(node.get(step), (dict, list)):
                bare = node.get(step)
                node[step] = {BARE[step]: bare} if step in BARE and isinstance(bare, str) else {}
            node = node[step]


def _entry(entries: list[Any], step: str, where: ConfigPath) -> int:
    if not (step.isascii() and step.isdecimal()) or len(step) > 9 or int(step) >= len(entries):
        raise where.error(f"--set: {shown(step)} is no entry of this list", f"it has {len(entries)}, counted from 0")
    return int(step)
