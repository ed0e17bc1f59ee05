# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages in the panel's words: fields and buttons instead of a preset's keys and a command line's options."""

import re

from ..core.labels import american, parameter_label, title
from ..core.perturbing.kinds import Perturbation
from ..perturbations import registry
from .document import PANEL

_KEYS = {
    "seed": "Perturbations > Seed",
    "scenes.#.name": "Scene > Name", "scenes.#.mesh": "Scene", "scenes.#.blend": "This Scene",
    "scenes.#.scene": "This Scene", "scenes.#.camera": "Trajectory > Scene Camera",
    "scenes.#.frames": "Trajectory > Scene Camera", "scenes.#.depth_alpha": "Scene > Depth Alpha",
    "scenes.#.sequence": "Scene > Folder", "scenes.#.poses": "Trajectory > Without Pose",
    "scenes.#.rate_hz": "Trajectory > Frame Rate", "scenes.#.undistort": "Scene > Undistort",
    "scenes.#.register": "Scene > Register Depth", "scenes.#.video": "Scene > Video", "scenes.#.depth": "Scene > Depth",
    "scenes.#.depth_scale_per_m": "Scene > Depth Scale",
    "scenes.#": "Scene", "scenes": "Scene",
    "scenes.#.trajectory": "Trajectory", "scenes.#.trajectory.file": "Trajectory > File",
    "scenes.#.trajectory.format": "Trajectory > Format", "scenes.#.trajectory.pose": "Trajectory > Pose",
    "scenes.#.trajectory.axes": "Trajectory > Axes", "scenes.#.trajectory.every": "Trajectory > Every Nth Pose",
    "scenes.#.trajectory.rate_hz": "Trajectory > Frame Rate",
    "scenes.#.trajectory.stamp_unit": "Trajectory > Stamp Unit",
    "scenes.#.trajectory.handheld": "Trajectory", "scenes.#.trajectory.handheld.frames": "Trajectory > Length",
    "scenes.#.trajectory.handheld.rate_hz": "Trajectory > Frame Rate",
    "scenes.#.trajectory.handheld.speed_m_s": "Trajectory > Speed",
    "scenes.#.trajectory.handheld.clearance_m": "Trajectory > Clearance",
    "camera": "Camera", "camera.width": "Camera > Width", "camera.height": "Camera > Height",
    "camera.fx": "Camera > fx", "camera.fy": "Camera > fy", "camera.cx": "Camera > cx", "camera.cy": "Camera > cy",
    "camera.near_m": "Camera > Near", "camera.far_m": "Camera > Far",
    "render": "Render and Output", "render.engine": "Render and Output > Engine",
    "render.samples": "Render and Output > Samples", "render.backend": "Render and Output > Backend",
    "settings": "Perturbations", "settings.#.name": "Render and Output > Setting", "perturbations": "Perturbations",
    "settings.#.perturb": "Perturbations", "motion": "Deviation and Speed",
    "output": "Render and Output", "output.layout": "Render and Output > Layout",
    "output.image": "Render and Output > Images", "output.colour": "Render and Output > Channels",
    "output.depth_scale_per_m": "Render and Output > Depth Scale",
    "output.depth_beyond": "Render and Output > Beyond Range", "output.modalities": "Render and Output > Write",
    "output.overview": "Render and Output > Overview",
}  # fmt: skip
"""The field of the panel that gives a key of a preset; # stands for a number."""

_OWN_KEYS = {"severity": "Severity", "mode": "Mode", "levels": "Severity", "temporal": "Pattern"}
_ANOTHER = "choose another folder under Output"
_OPTIONS = (
    (r"keep the path, and choose its first frames with --frames \S+, or give it", "keep the path, or give it"),
    (r"choose another folder with --out, or replace the dataset with --overwrite", f"{_ANOTHER}, or Replace Dataset"),
    (r"choose another (folder )?with --out", _ANOTHER),
    (r"choose another --out", _ANOTHER),
    (r"use --overwrite|with --overwrite", "press Replace Dataset"),
    (r"make room there and run the same command again", "make room there and press Generate again"),
    (r"; see --list keys|; paths are relative to the preset", ""),
    (r"set render\.processors: any where [^;]*", "save the preset, and set render.processors to any in its file"),
    (r"\bgive it another name\b", "give Scene > Name or Render and Output > Setting another name"),
    (r"\bgive it backend: reference\b", "choose Reference under Render and Output > Backend"),
    (r"\bthe same command\b", "Generate"),
)
"""What a command line's user is told, and what is said here."""


def spoken(message: str, file: str = PANEL) -> str:
    """Return a message in the panel's words. file: the preset that it may name, which stands for the panel."""
    text = message
    for name in {file, PANEL}:
        text = _without_file(text, name)
    for pattern, words in _OPTIONS:
        text = re.sub(pattern, words, text)
    return american(_fields(text))


def _without_file(text: str, file: str) -> str:
    """Replace a file's name and the key after it by the field, at the beginning of a text."""
    if not text.startswith(f"{file}: "):
        return text
    rest = text.removeprefix(f"{file}: ")
    key, colon, problem = rest.partition(": ")
    return f"{field_of(key)}: {problem}" if colon and re.fullmatch(r"[\w.]+", key) else rest


def _fields(text: str) -> str:
    """Replace the keys that no reader of the panel knows, such as near_m, where they stand alone."""
    dotted = {key: label for key, label in _KEYS.items() if "." in key and "#" not in key}
    last = {key.rpartition(".")[2]: label for key, label in _KEYS.items() if "_" in key}
    names = {key: label.rpartition("> ")[2] for key, label in (dotted | last).items()}
    pattern = rf"(?<![\w/\\.])({'|'.join(map(re.escape, sorted(names, reverse=True)))})(?![\w/\\]|\.\w)"
    return re.sub(pattern, lambda match: names[match.group()], text)


def field_of(key: str) -> str:
    """Return the field of the panel that gives a key of a preset; the key itself where there is none."""
    parts = ["#" if part.isdigit() else part for part in key.split(".")]
    for place, part in enumerate(parts):
        if part in registry() and place and parts[place - 1] == "#":
            return _field_of_step(registry()[part], parts[place + 1 :])
    for end in range(len(parts), 0, -1):
        if (label := _KEYS.get(".".join(parts[:end]))) is not None:
            return label
    return key


def _field_of_step(perturbation: Perturbation, inside: list[str]) -> str:
    name = title(perturbation.label)
    if not inside:
        return name
    return f"{name} > {_OWN_KEYS.get(inside[0]) or parameter_label(inside[0])}"
