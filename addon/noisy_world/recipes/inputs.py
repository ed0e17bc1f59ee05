# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that a scene's inputs are those that a recipe was made from."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..core.datasets.json_text import plain_values
from ..core.datasets.provenance import path_sha256
from ..core.datasets.recorded_setting import RecordedSetting
from ..core.errors import InputError
from ..core.perturbing.given_files import files_of, sha256_of
from ..core.perturbing.steps import Setting
from ..core.planning.scene import Scene

HASHED = "_sha256"


def different_input(wanted: Mapping[str, Any], here: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the first key in which the inputs of a scene differ, with both values in words; None where none does.

    A file may be called otherwise, if it is the same.
    """
    for name in sorted({*wanted, *here}):
        hashed = f"{name}{HASHED}"
        renamed = bool(wanted.get(hashed)) and wanted.get(hashed) == here.get(hashed)
        if wanted.get(name) != here.get(name) and not renamed:
            return name, f"is {_format_value(here.get(name))}, and the recipe's {_format_value(wanted.get(name))}"
    return None


def check_inputs(file: Path, wanted: Mapping[str, Any], scene: Scene) -> None:
    """Raise InputError where a scene's files are not those that a recipe was made from.

    file: the recipe. wanted: the scene in its identity.
    """
    here = plain_values(scene.source.hashes())
    if found := different_input(wanted["inputs"], here):
        name, difference = found
        key = name.removesuffix(HASHED)
        named, location = f"{here.get(key, key)}", scene.source.location
        what = location if Path(location).name == named else named
        problem = f"{what} is not what the recipe was made from: its {name} {difference}"
        raise InputError(file, problem, where=f"scenes: {scene.name}", remedy="--data DIR names the folder of another")


def check_setting(file: Path, wanted: Mapping[str, Any], setting: Setting) -> None:
    """Raise InputError where the files of a setting's steps are not those that a recipe was made from.

    file: the recipe. wanted: the setting in its identity.
    """
    recorded = RecordedSetting.read(wanted)
    for step, made in zip((*setting.sensor, *setting.steps), (*recorded.sensor, *recorded.steps), strict=False):
        severity = step.severity if step.levels is None else step.levels[0]
        for name, path in {} if severity == 0 else files_of(step.parameters(severity)).items():
            here, there = sha256_of(path), (made.parameters[0] or {}).get(name, {}).get("sha256")
            if here != there:
                problem = f"{path} is not what the recipe was made from: its sha256 is {here[:12]}..."
                where = f"settings: {setting.name}: {step.perturbation.name}.{name}"
                raise InputError(file, problem, where=where, remedy="--data DIR names the folder of another")


def same_path(wanted: Mapping[str, Any], scene: Scene) -> bool:
    """Tell whether a scene has the recipe's path to the last bit. wanted: the scene in its identity."""
    source, path = scene.source, wanted["path"]
    if len(source.stamps_s) != path["frames"]:
        return False
    return path_sha256(scene.path, source.stamps_s, path["frames"]) == path["sha256"]


def _format_value(value: object) -> str:
    return f"{value[:12]}..." if isinstance(value, str) and len(value) == 64 else repr(value)
