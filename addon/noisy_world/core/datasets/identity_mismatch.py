# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares identities: whether one process may add frames to a dataset that another has begun."""

from collections.abc import Mapping
from typing import Any

from ..messages import Message, either
from ..presets.preset import canonical
from .differences import PROCESSORS, first_difference
from .storage import sha256_of_bytes


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
