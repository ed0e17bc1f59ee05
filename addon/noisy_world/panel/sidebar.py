# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences in a sidebar, which is narrow: on as many lines as they need, by the widths of their letters."""

from typing import TYPE_CHECKING

import blf
import bpy

from ..core.errors import american

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import IconItems

FONT = 0  # Blender's own
WIDTH = 220  # of a region, where there is none to measure: a sidebar as it opens
# At a scale of 1, found by photographs: what a line of a sidebar has beside its text, and of a dialog.
BESIDE_PX, BESIDE_IN_DIALOG_PX = 80, 60


def write(
    layout: bpy.types.UILayout,
    context: bpy.types.Context,
    text: str,
    icon: "IconItems" = "NONE",
    *,
    taken: int = 0,
    dialog: int = 0,
) -> None:
    """Write a text on as many lines as the region's width requires. taken: of the width, by others, in pixels.

    dialog: the width of the dialog that it stands in, in pixels at a scale of 1; 0 for none.
    """
    scale = context.preferences.system.ui_scale or 1.0  # 0 without a window
    region = WIDTH if context.region is None else context.region.width / scale
    room = dialog - BESIDE_IN_DIALOG_PX if dialog else region - BESIDE_PX
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(wrapped(american(text), room - taken)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1")


def wrapped(text: str, width: float) -> list[str]:
    """Return a text's lines, none of which is wider than this; a word that is wider is parted. width: at a scale of 1,
    in pixels.
    """
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and width_of(longer) <= width:
            lines[-1] = longer
            continue
        lines.append(word)
        while len(lines[-1]) > 1 and width_of(lines[-1]) > width:
            fits = max(1, next(n for n in range(len(lines[-1]), 0, -1) if n == 1 or width_of(lines[-1][:n]) <= width))
            lines[-1:] = [lines[-1][:fits], lines[-1][fits:]]
    return lines


def width_of(text: str) -> float:
    """Return how wide Blender draws a text in its interface, in pixels at a scale of 1."""
    styles = bpy.context.preferences.ui_styles
    blf.size(FONT, styles[0].widget.points)
    return blf.dimensions(FONT, text)[0]
