# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of shots as properties of a scene: each a camera, frames, perturbations, a seed and a folder."""

from functools import partial
from typing import Any

import bpy

from .described import LARGEST_INT

_flag = partial(bpy.props.BoolProperty, options=set())
_whole = partial(bpy.props.IntProperty, options=set())
_text = partial(bpy.props.StringProperty, options=set())

PANEL_LIST, OWN_LIST, PRESET_LIST = "PANEL", "OWN", "PRESET"


def _is_camera(_: Any, item: bpy.types.Object) -> bool:
    return item.type == "CAMERA"


def _shot_members() -> dict[str, Any]:
    return {
        "name": _text(name="Name", description="The shot's name, in this list and in what is said of it"),
        "enabled": _flag(name="Enabled", description="Whether Generate Shots takes this shot", default=True),
        "camera": bpy.props.PointerProperty(
            type=bpy.types.Object, name="Camera", poll=_is_camera,
            description="The camera that the shot is seen through",
        ),
        "frame_start": _whole(name="First Frame", description="The scene's frame that the shot begins with", default=1),
        "frame_end": _whole(name="Last Frame", description="The last frame of the scene that is shown", default=250),
        "perturbations": bpy.props.EnumProperty(
            options=set(),
            name="Perturb By",
            description="Where the shot's perturbations come from",
            items=[
                (PANEL_LIST, "Panel", "The list above and the deviation, as they are when Generate Shots is pressed"),
                (OWN_LIST, "Own List", "The list as it was when the shot was added or Keep List was pressed"),
                (PRESET_LIST, "Preset", "A setting of a preset's file"),
            ],
        ),
        "own_list": _text(options={"HIDDEN"}),
        "preset": _text(
            name="Preset", description="The preset whose perturbations the shot has", subtype="FILE_PATH",
            options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        ),
        "setting": _text(
            name="Setting", description="The preset's setting; empty: the first that is not clean"
        ),
        "seed": _whole(name="Seed", description="Seed of the shot's random patterns", min=0, max=LARGEST_INT),
        "output_folder": _text(
            name="Output", description="Folder of the shot's dataset", subtype="DIR_PATH",
            options={"PATH_SUPPORTS_BLEND_RELATIVE"},
        ),
    }  # fmt: skip


NoisyWorldShot: type = type(
    "NoisyWorldShot", (bpy.types.PropertyGroup,), {"__annotations__": _shot_members(), "__module__": __name__}
)


def shot_list_members() -> dict[str, Any]:
    """Return the properties of a scene that hold its shots."""
    return {
        "shots": bpy.props.CollectionProperty(type=NoisyWorldShot, name="Shots", description="Made by Generate Shots"),
        "active_shot": _whole(name="Active Shot", description="The shot whose values are shown", min=0),
    }


def active_shot(panel: Any) -> Any | None:
    """Return the selected shot, where there is one."""
    return panel.shots[panel.active_shot] if 0 <= panel.active_shot < len(panel.shots) else None
