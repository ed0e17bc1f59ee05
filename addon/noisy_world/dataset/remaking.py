# SPDX-License-Identifier: GPL-3.0-or-later
"""A recipe as a plan: its preset with the inputs that lie here, checked against the recipe's hashes."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core.errors import InputError, one_line
from ..core.file_access import plain_values
from ..perturbations import registry
from ..perturbations.steps import Setting, files_of, sha256_of
from ..preset.keys import Preset, check_document
from ..preset.names import chosen_part
from ..sources import read_scenes
from ..sources.scene_kinds import Scene
from .differences import was_is
from .identity import HUFFMAN, RecordedSetting, base_versions, path_sha256, processor, relevant_entry
from .plan import Plan, Render, make_plan, needed_sources, read_settings
from .recipe import Recipe

# Checks that a scene's inputs are those that a recipe was made from.


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


# Compares versions and processor with a recipe's; bytes are equal only where these are.


BOUND = "pixels may differ by 1/255, and by more where noise falls on the other side of a threshold"
TABLES = "noisy JPEG images have other Huffman tables than the recipe's, for the same pixels"


def made_otherwise(recipe: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return in a line what makes other bytes than a recipe's, "" where nothing does.

    recipe, here: identities. Versions of what only one of them needs do not count.
    """
    versions = {
        name: (recipe["versions"].get(name, "none"), version)
        for name, version in here["versions"].items()
        # Python itself decides no byte; deflate does since it compresses PNG files.
        if name != "python" and recipe["versions"].get(name, version if name != "deflate" else None) != version
    }
    parts = [f"{name} {was_is(*pair)}" for name, pair in versions.items()]
    if other := _processor(recipe["processor"], here["processor"]):
        parts.append(other)
    return one_line(f"made with others than the recipe: {'; '.join(parts)}: {BOUND}") if parts else ""


def written_otherwise(recipe: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return in a line what makes other files of a dataset than a recipe's, "" where nothing does. Both: identities."""
    found = made_otherwise(recipe, here)
    if here["output"].get(HUFFMAN) == recipe["output"].get(HUFFMAN):
        return found
    return "; ".join([*([found] if found else []), TABLES])


def _processor(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    if there == here:
        return ""
    for key in ("machine", "byte_order"):
        if there[key] != here[key]:
            return f"processor {was_is(there[key], here[key])}"
    lacks, more = sorted({*there["features"]} - {*here["features"]}), sorted({*here["features"]} - {*there["features"]})
    lines = [f"{word} {', '.join(names)}" for word, names in (("without", lacks), ("with", more)) if names]
    return f"a processor {' and '.join(lines)}"


def made_here() -> dict[str, Any]:
    """Return what this process would make frames with, apart from what renders them, as an identity has it."""
    return {"versions": base_versions(), "processor": processor()}
