# SPDX-License-Identifier: GPL-3.0-or-later
"""Why a dataset cannot grow by a plan, as the first difference in the preset's words.

A dataset grows where what is common to all frames is equal, and each scene and setting that both name.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..channels import COLOUR_AND_DEPTH, in_order, pair_channels
from ..core.atomic_files import sha256_of_bytes
from ..core.errors import Action, CommandLineOnly, Message, PresetKey, StorageError, either, offers
from ..core.file_access import canonical
from ..core.frame_request import SensorPaths
from ..core.trajectory import recentring_m
from ..preset.names import format_same_folder
from .identity import BETWEEN, CHANNELS, HUFFMAN, KEYS, RecordedSetting, RecordedStep, path_sha256

if TYPE_CHECKING:
    from ..sources.scene_kinds import Scene
    from .plan import Plan
    from .sequence import PlannedSequence

ELSEWHERE = (Action.OTHER_FOLDER, Action.OVERWRITE)
ANOTHER_FOLDER = either(*ELSEWHERE)
ANOTHER_NAME = either(Action.OTHER_NAME, *ELSEWHERE)
PROCESSORS = Message(
    "set ", PresetKey("render.processors", "any"),
    " where frames of unlike processors, within 1/255 of each other, are good enough",
)  # fmt: skip
COMMON = ("seed", "near_m", "far_m", "rig", "render", "output")
IN_PRESET = {"near_m": "camera.near_m", "far_m": "camera.far_m"}  # where they stand there
DECIDE_OTHERS = ("layout", "file")  # keys whose values decide what others mean or default to
PATH_INPUTS = ("trajectory", "trajectory_sha256")  # the poses are compared instead


def why_not(there: dict[str, Any], here: dict[str, Any], plan: Plan) -> str | None:
    """Return why a dataset with the identity `there` cannot take what a plan with the identity `here` makes, or None.

    The text is the first difference that tells most, and the remedy.
    """
    any_processor = plan.preset.spec.render.processors == "any"
    for key in COMMON:
        if None not in (there[key], here[key]) and there[key] != here[key]:
            return Message(_common(key, there[key], here[key]), ANOTHER_FOLDER)
    if problem := _keys(there, here):
        return Message(problem, ANOTHER_FOLDER)
    for kind, names in (("settings", plan.settings), ("scenes", plan.scenes)):
        if problem := _one_folder(there[kind], [item.name for item in names]):
            return Message(f"{kind}: {problem}", ANOTHER_NAME)
    for setting in plan.settings:
        if setting.name in there["settings"]:
            before, now = there["settings"][setting.name], here["settings"][setting.name]
            if before != now:
                return Message(f"settings: {setting.name} {_setting(before, now)}", ANOTHER_NAME)
    for scene in plan.scenes:
        if scene.name in there["scenes"]:
            before, now = there["scenes"][scene.name], here["scenes"][scene.name]
            problem = _scene(scene, before, now) or _path(scene, before, now, any_processor=any_processor)
            if problem := problem or _longer(scene, there["sequences"], plan):
                return problem
    return _made_with(there, here, any_processor=any_processor)


def _keys(there: dict[str, Any], here: dict[str, Any], where: str = "") -> str | None:
    """Return which key that decides bytes by its own value differs, with both values, or None."""
    return first_difference(there.get(KEYS, {}), here.get(KEYS, {}), where)


def _one_folder(there: Iterable[str], here: Iterable[str]) -> str | None:
    """Return in words which names are one folder's where case is not told apart, or None."""
    known = {name.casefold(): name for name in there}
    taken = ((name, known.get(name.casefold(), name)) for name in here)
    return next((format_same_folder(name, other) for name, other in taken if name != other), None)


def first_difference(there: Any, here: Any, where: str = "") -> str | None:
    """Return the keys of the first difference of two JSON values, with both values as text, or None."""
    if isinstance(there, dict) and isinstance(here, dict):
        parts = [(name, there.get(name), here.get(name)) for name in sorted({*there, *here}, key=_telling)]
    elif isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        parts = [(str(index), left, right) for index, (left, right) in enumerate(zip(there, here, strict=True))]
    else:
        return None if there == here else Message(PresetKey(where), " ", was_is(there, here))
    inside = (first_difference(left, right, f"{where}.{name}" if where else name) for name, left, right in parts)
    return next((found for found in inside if found), None)


def was_is(there: Any, here: Any) -> str:
    """Return both values in words."""
    return f"was {_short(there)}, is {_short(here)}"


def _telling(name: str) -> tuple[bool, str]:
    return name not in DECIDE_OTHERS, name


def _short(value: object) -> str:
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        value = int(value)
    text = value if isinstance(value, str) and value.isprintable() and value else json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _common(key: str, there: Any, here: Any) -> str:
    name = IN_PRESET.get(key, key)
    if key == "rig" and (there or {}).get("imu") != (here or {}).get("imu"):
        before, now = (content.get("imu") for content in (there or {}, here or {}))
        return first_difference(before, now, f"{name}.imu") or f"{name}.imu"
    if key == "rig":
        return f"{name}: the sensors have other poses on the robot than in the dataset"
    if key == "output":
        tables = "made before noisy JPEG images had Huffman tables of their own, so bytes of equal images would differ"
        return first_difference({**there, HUFFMAN: None}, {**here, HUFFMAN: None}, name) or tables
    return first_difference(there, here, name) or name


# --- settings ---


def _setting(there: dict[str, Any], here: dict[str, Any]) -> str:
    """Return in which step and value two settings differ, in words."""
    before, now = RecordedSetting.read(there).steps, RecordedSetting.read(here).steps
    names = [[step.name for step in steps] for steps in (before, now)]
    if names[0] != names[1]:
        return was_is(*(", ".join(item) or "clean" for item in names))
    for number, (left, right) in enumerate(zip(before, now, strict=True)):
        if found := _step(left, right):
            alone = len(names[0]) == 1
            key, values = found
            nth = f" {names[0][: number + 1].count(left.name)}" if names[0].count(left.name) > 1 else ""
            return f"({key if alone else left.name + nth + '.' + key}) {values}"
    if problem := _keys(there, here):
        return problem
    for key, absent in (("backend", None), ("stream", "its own name")):
        if there.get(key, absent) != here.get(key, absent):
            return f"({key}) {was_is(there.get(key, absent), here.get(key, absent))}"
    return first_difference(there, here) or was_is(there, here)


def _step(there: RecordedStep, here: RecordedStep) -> tuple[str, str] | None:
    """Return the key in which two steps of the same perturbation differ, and both values."""
    if there.version != here.version:
        return "version", was_is(there.version, here.version)
    if there.mode != here.mode:
        return "mode", was_is(there.mode, here.mode)
    if (there.severity, there.levels) != (here.severity, here.levels):
        key = "severity" if there.mode == "static" else "levels"
        return key, was_is(getattr(there, key), getattr(here, key))
    if there.temporal != here.temporal:
        return "temporal", was_is(there.temporal, here.temporal)
    for left, right in zip(there.parameters, here.parameters, strict=True):
        before, now = left or {}, right or {}
        for name in sorted({*before, *now}):
            if before.get(name) != now.get(name):
                return name, was_is(before.get(name), now.get(name))
    return None if there == here else ("parameters", was_is(there.parameters, here.parameters))


# --- scenes ---


def _scene(scene: Scene, there: dict[str, Any], here: dict[str, Any]) -> str | None:
    """Return how the files or the camera of a scene differ, but for its path."""
    from ..render.source import DRAWN, PERTURBED

    before, now, place = there["inputs"], here["inputs"], scene.place.path
    for name in sorted({*before, *now} - set(PATH_INPUTS)):
        hashed = f"{name}_sha256"
        if before.get(name) == now.get(name) or (before.get(hashed) and now.get(hashed)):
            continue  # a file may be called otherwise
        if name == PERTURBED:
            how = "environment and lens act on its light before the view transform, but after it in the dataset"
            return Message(PresetKey(place), f": {how}, which an earlier version made", ANOTHER_NAME)
        if name == DRAWN:
            how = "weather and dirt are drawn otherwise on its light than in the dataset"
            return Message(PresetKey(place), f": {how}, which another version made", ANOTHER_NAME)
        if name.endswith("_sha256") and before.get(name) and now.get(name):
            key = name.removesuffix("_sha256")
            own = Message(PresetKey(f"{place}.{key}"), f": {_short(now[key])} is") if key in now else ""
            what = own or Message(PresetKey(place), f": its {key} are")
            return Message(what, " not what the dataset was made from", ANOTHER_NAME)
        changed = PresetKey(f"{place}.{name.removesuffix('_sha256')}")
        return Message(changed, f" {was_is(before.get(name), now.get(name))}", ANOTHER_NAME)
    if problem := _keys(there, here, place):
        return Message(problem, ANOTHER_NAME)
    if there.get(CHANNELS) != here.get(CHANNELS):
        message = ": the file of its objects' names is not what the dataset was made from"
        return Message(PresetKey(place), message, ANOTHER_NAME)
    if there["camera"] != here["camera"]:
        return Message(first_difference(there["camera"], here["camera"], "camera") or "camera", ANOTHER_FOLDER)
    return None


def _path(scene: Scene, there: dict[str, Any], here: dict[str, Any], *, any_processor: bool) -> str | None:
    """Return how the path of a scene differs in the frames that the dataset's path has; None where it goes on.

    any_processor: whether last bits are allowed to differ, where everything that a path is made from is equal.
    """
    before, now = there["path"], here["path"]
    where = scene.place.path
    between = {item[BETWEEN] for item in (before, now) if BETWEEN in item}
    if before["frames"] == now["frames"] and len(between) > 1:
        message = ": its path goes another way between the poses than the dataset's"
        return Message(PresetKey(where), message, ANOTHER_NAME)
    if {**before, BETWEEN: None} == {**now, BETWEEN: None}:
        return None
    where = scene.path_place.path
    key = where.rpartition(".")[2]
    changed = first_difference(there["entry"].get(key), here["entry"].get(key), where)
    if any_processor and changed is None and there["inputs"] == here["inputs"] and before["frames"] == now["frames"]:
        return None
    if now["frames"] >= before["frames"]:
        if before["sha256"] == path_sha256(scene.path, scene.source.stamps_s, before["frames"]):
            return None
    elif changed is None or changed.startswith(
        (f"{where}.stop ", f"{where}.handheld.frames ", f"{scene.place.path}.frames ")
    ):
        message = f": the path was {before['frames']} frames long, is {now['frames']}"
        cause = changed or Message(PresetKey(where), message)
        shorter = f"keep the path, and choose its first frames with --frames 0:{now['frames']}"
        return Message(cause, either(CommandLineOnly(shorter), Action.OTHER_NAME, *ELSEWHERE))
    name = here["inputs"].get("trajectory")
    if changed:
        return Message(changed, ", which makes another path", ANOTHER_NAME)
    if _was_unrounded(scene, before):
        how = "its poses were not rounded yet when the dataset was begun, and are now, to the nanometre"
        return Message(PresetKey(where), f": {how}", ANOTHER_NAME)
    return Message(PresetKey(where), f": {_short(name)} has other poses or stamps", ANOTHER_NAME)


def _was_unrounded(scene: Scene, path: dict[str, Any]) -> bool:
    """Tell whether a dataset's path is the scene's as earlier versions had it, with all digits of its poses."""
    source = scene.source
    return path["sha256"] == path_sha256(source.trajectory(), source.stamps_s, path["frames"])


def _longer(scene: Scene, counts: dict[str, int], plan: Plan) -> str | None:
    """Return what looks different in the dataset's frames now that the path of a scene is longer.

    counts: how long the path was that each sequence of the dataset was made from.
    """
    from .rendering import source_paths

    path = PresetKey(scene.path_place.path)
    for render in plan.renders:
        for sequence in render.sequences if render.scene.name == scene.name else ():
            count = counts.get(sequence.folder, scene.frame_count)
            if not 0 < count < scene.frame_count:
                continue
            if led_on := pair_channels(plan.format.modalities):
                message = f"the {led_on[0].spoken} of what was the last frame leads on, now that it is longer"
                return Message(path, f": {message}", ANOTHER_NAME)
            before, after = source_paths(plan, render, count), source_paths(plan, render)
            clocked = render.unit is not None and render.unit.clock is not None
            if render.exposure or clocked:
                looks = "a setting" if render.exposure else "rig.depth"
                message = f"which {looks} looks at, lies otherwise now that the path is longer"
                return Message(path, f": what is between the poses of {scene.name}, {message}", ANOTHER_NAME)
            capabilities = scene.source.capabilities
            moved = capabilities.rendered and capabilities.own is None  # others stay where they are
            if moved and not np.array_equal(recentring_m(before.rgb), recentring_m(after.rgb)):
                far = "so far from the origin, a longer path is rendered around another point"
                return Message(path, f": {far}, and float32's rounding shows", ANOTHER_NAME)
            if not _goes_on(sequence, count, before, after):
                setting, steps = sequence.setting, sequence.setting.steps
                named = f" ({', '.join(step.perturbation.name for step in steps)})" if steps else ""
                problem = f"changes frames that are there, now that the path of {scene.name} is longer"
                return Message(f"settings: {setting.name}{named} {problem}", ANOTHER_NAME)
    return None


def _goes_on(sequence: PlannedSequence, count: int, before: SensorPaths, after: SensorPaths) -> bool:
    """Tell whether a sequence shows in each frame of a path's first `count` poses the same as on the longer path.

    before, after: the sensors' paths, of the first poses and of all.
    """
    from .sequence import array_of, lay_out

    shorter = lay_out(sequence.setting, sequence.scene, count, sequence.identifiers)
    for frame in shorter.frames:
        if sequence.leaves_out(frame) or shorter.shown(frame) != sequence.shown(frame):
            return False
    rows = array_of(shorter.sources(in_order(COLOUR_AND_DEPTH)))
    return all(
        np.array_equal(left.c2w[rows], right.c2w[rows])
        for left, right in zip(before.named().values(), after.named().values(), strict=True)
    )


# --- what it is made with ---


def _made_with(there: dict[str, Any], here: dict[str, Any], *, any_processor: bool) -> str | None:
    if "deflate" not in there["versions"]:
        return Message(
            "made before deflate compressed PNG files, so bytes of equal images would differ", ANOTHER_FOLDER
        )
    for name in sorted({*there["versions"]} & {*here["versions"]}):
        before, now = there["versions"][name], here["versions"][name]
        if before != now:
            return Message(f"made with {name} {_short(before)}, this is {_short(now)}", ANOTHER_FOLDER)
    if not any_processor and (found := first_difference(there["processor"], here["processor"])):
        return Message("made on another processor: ", found, either(PROCESSORS, *ELSEWHERE))
    return None


def other_dataset(out: Path, problem: str) -> StorageError:
    """Return the error that says why a folder cannot take a dataset in, and what to do about it."""
    remedy = "" if offers(problem, Action.OVERWRITE) else ANOTHER_FOLDER
    return StorageError(Message("holds another dataset: ", problem), file=out, remedy=remedy)


# Compares identities: whether one process may add frames to a dataset that another has begun.


def decisive(identity: dict[str, Any]) -> dict[str, Any]:
    """Return what of an identity decides the bytes that a given processor makes.

    Without the preset's text, which is there for people; without the hashes of paths, whose making may take seconds and
    whose poses follow from the rest; without the processor.
    """
    texts = ("preset", "preset_sha256", "processor")
    scenes = {
        name: {**{key: part for key, part in scene.items() if key != "entry"}, "path": scene["path"]["frames"]}
        for name, scene in identity["scenes"].items()
    }
    return {**{key: part for key, part in identity.items() if key not in texts}, "scenes": scenes}


def identity_sha256(identity: dict[str, Any]) -> str:
    """Return the SHA-256 of what of an identity is decisive."""
    return sha256_of_bytes(canonical(decisive(identity)).encode())


def clean_identity(identity: Mapping[str, Any], scene: str, setting: str) -> dict[str, Any]:
    """Return what of an identity decides the clean frames of a render.

    setting: whose steps move or expose the frames; "" for those of the scene as it is.
    """
    others = ("preset", "preset_sha256", "output", "sequences")
    known = {key: part for key, part in identity["scenes"][scene].items() if key not in ("entry", "robot_axes")}
    steps = {setting: identity["settings"].get(setting)} if setting else {}
    made_from = {key: part for key, part in identity.items() if key not in others}
    return {**made_from, "scenes": {scene: known}, "settings": steps}


def identity_mismatch(there: dict[str, Any], here: dict[str, Any], *, any_processor: bool) -> str:
    """Return why frames of the identity `here` are not those of `there`, which may say more than that; "" if they are.

    any_processor: whether another kind of processor is none.
    """
    if difference := first_difference(decisive(_narrowed(there, here)), decisive(here)):
        return difference
    if not any_processor and (difference := first_difference(there["processor"], here["processor"], "processor")):
        return Message("made on another processor: ", difference, either(PROCESSORS))
    return ""


def _narrowed(there: dict[str, Any], here: dict[str, Any]) -> dict[str, Any]:
    """Return an identity without the scenes, settings, sequences and versions that another one does not name."""
    parts = ("scenes", "settings", "sequences", "versions")
    undecided = {key: None for key in ("near_m", "far_m", "rig", "render") if here[key] is None}
    # Asked by the names of the other: a shard has one scene of a dataset's hundreds.
    return {**there, **undecided, **{key: {k: there[key][k] for k in here[key] if k in there[key]} for key in parts}}
