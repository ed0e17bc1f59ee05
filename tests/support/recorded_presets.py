# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets whose scenes are datasets made by arithmetic."""

import json

from runs import run
from written import world


def camera(width=8, height=6, **values):
    return {"width": width, "height": height, "fx": 4.0, "fy": 4.0, "cx": 3.5, "cy": 2.5, **values}


def preset_of(folder, *scenes, **keys):
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "preset.json"
    path.write_text(json.dumps({"seed": 3, "scenes": scenes, "render": {"backend": "reference"}, **keys}))
    return path


def recorded(folder, layout="replica", **keys):
    """Write a dataset of one sequence, source/clean/box."""
    run(world(folder / "w", layout, output={"image": "png"}, **keys), folder / "source")
    return folder / "source/clean/box"
