# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel's fields of a lens that distorts: of the camera that meshes are seen through, or laid over a recording."""

from typing import Any

import bpy

from ..core.optics import MODELS
from ..core.presets.distortion import OF_ANGLE, DistortionSpec
from .described import described, tell
from .typed_numbers import set_value, value_of

COEFFICIENTS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
LENS_UPDATE = "distortion"  # what listeners are told


def lens_members() -> dict[str, Any]:
    """Return the properties, by name."""
    return {
        "distorts": bpy.props.BoolProperty(
            options=set(),
            name="Distortion",
            description="Show frames through a lens that distorts. Viewport and previews of meshes stay a pinhole's",
            update=tell(LENS_UPDATE),
        ),
        "distortion_model": described(DistortionSpec, "model", label="Lens Model", update=LENS_UPDATE),
        **{
            f"distortion_{name}": described(
                DistortionSpec, name, label=name.upper(), update=LENS_UPDATE, precision=6, soft_min=-1.0, soft_max=1.0
            )
            for name in COEFFICIENTS
        },
        "distortion_undistort": described(DistortionSpec, "undistort", label="Undistort Again", update=LENS_UPDATE),
    }


def distortion_of(panel: Any, *, rendered: bool) -> dict[str, Any]:
    """Return the lens as a preset has it: {} without one, else under its key. rendered: not laid over a recording."""
    if not panel.distorts:
        return {}
    said = {name: value_of(panel, f"distortion_{name}") for name in _shown(panel)}
    given: dict[str, Any] = {"model": panel.distortion_model, **{name: value for name, value in said.items() if value}}
    if rendered and panel.distortion_undistort:
        given["undistort"] = True
    return {"distortion": given}


def take_distortion(panel: Any, spec: DistortionSpec | None) -> None:
    """Set the panel from a preset's lens; None for none."""
    panel.distorts = spec is not None
    if spec is None:
        return
    panel.distortion_model, panel.distortion_undistort = spec.model, spec.undistort
    for name in COEFFICIENTS:
        set_value(panel, f"distortion_{name}", getattr(spec, name))


def draw_distortion(layout: bpy.types.UILayout, panel: Any, *, rendered: bool) -> None:
    """Draw the fields that the lens's model has."""
    layout.prop(panel, "distorts")
    if not panel.distorts:
        return
    layout.prop(panel, "distortion_model")
    column = layout.column(align=True)
    for name in _shown(panel):
        column.prop(panel, f"distortion_{name}")
    if rendered:
        layout.prop(panel, "distortion_undistort")


def _shown(panel: Any) -> tuple[str, ...]:
    return OF_ANGLE if panel.distortion_model == MODELS[1] else COEFFICIENTS
