# SPDX-License-Identifier: GPL-3.0-or-later
"""A recipe as a plan: its preset with the inputs that lie here, checked against the recipe's hashes."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core.datasets.provenance import relevant_entry
from ..core.errors import InputError
from ..core.planning.plan import Plan, Render, needed_sources, read_settings
from ..core.presets.preset import Preset, check_document
from ..core.presets.selection import chosen_part
from ..perturbations import registry
from ..planning import make_plan
from ..sources import read_scenes
from .inputs import check_inputs, check_setting
from .recipe import Recipe

NAMED = 4  # names that a message lists


def preset_of(
    recipe: Recipe, data: Path | None = None, scenes: Sequence[str] = (), settings: Sequence[str] = ()
) -> Preset:
    """Return the preset of a recipe.

    data: the folder that the paths of its scenes begin at; default the recipe's. scenes, settings: names or globs of
    those that are wanted, if not all. Raises InputError.
    """
    document: dict[str, Any] = dict(recipe.identity["preset"])
    document["data"] = str((recipe.path.parent if data is None else data).absolute())
    if only := chosen_part(scenes, settings):
        document["only"] = only
    return check_document(document, recipe.path)


def plan_of(
    recipe: Recipe,
    data: Path | None = None,
    scenes: Sequence[str] = (),
    settings: Sequence[str] = (),
    frames: slice | None = None,
) -> Plan:
    """Return the plan of a part of a recipe, with its inputs checked. frames: of each sequence, if not all.

    Raises InputError, with the file, where an input is missing or is not the one that the recipe was made from.
    """
    named = _named(recipe)
    if not named:
        raise InputError(recipe.path, "its preset names none of its sequences", remedy="it can only verify a dataset")
    whole_scenes, whole_settings = (list(dict.fromkeys(name.split("/")[part] for name in named)) for part in (1, 0))
    plan = make_plan(preset_of(recipe, data, scenes or whole_scenes, settings or whole_settings), frames)
    for scene in plan.scenes:
        check_inputs(recipe.path, recipe.identity["scenes"].get(scene.name, {"inputs": {}}), scene)
    for setting in plan.settings:
        if (wanted := recipe.identity["settings"].get(setting.name)) is not None:
            check_setting(recipe.path, wanted, setting)
    renders = tuple(filter(None, (_within(recipe, plan, render) for render in plan.renders)))
    if not renders:
        message = ", ".join(sequence.folder for sequence in plan.sequences[:NAMED])
        raise InputError(recipe.path, f"knows nothing of {message}", remedy=f"it holds {_listed(named)}")
    return replace(plan, renders=renders)


def _within(recipe: Recipe, plan: Plan, render: Render) -> Render | None:
    """Return a render for the sequences that the recipe holds; a dataset may have grown by some scenes of a setting."""
    sequences = tuple(item for item in render.sequences if item.folder in recipe.sequences)
    if sequences == render.sequences or not sequences:
        return render if sequences else None
    return replace(render, sequences=sequences, frames=needed_sources(sequences, plan.format.modalities))


def unnamed_sequences(recipe: Recipe) -> str:
    """Return which sequences of a recipe its preset does not name, in words; "" where it names all.

    A dataset that has grown was made with several presets, and keeps the last one. Raises InputError.
    """
    named = set(_named(recipe))
    return _listed(name for name in recipe.names if name not in named)


def _named(recipe: Recipe) -> list[str]:
    """Return the sequences of a recipe that its preset names."""
    preset = preset_of(recipe)
    settings = {setting.name for setting in read_settings(preset, registry())}
    entries = [relevant_entry(entry) for entry in read_scenes(preset)]
    scenes = {name for name, scene in recipe.identity["scenes"].items() if scene["entry"] in entries}
    parts = [(name, *name.split("/")) for name in recipe.names]
    return [name for name, setting, scene in parts if setting in settings and scene in scenes]


def _listed(names: Iterable[str]) -> str:
    listed = list(names)
    return ", ".join(listed[:NAMED]) + (f" and {len(listed) - NAMED} more" if len(listed) > NAMED else "")
