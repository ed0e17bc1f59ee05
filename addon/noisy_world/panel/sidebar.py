# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences in a sidebar, which is narrow."""

import textwrap
from typing import TYPE_CHECKING

import bpy

from ..core.errors import american

if TYPE_CHECKING:
    from bpy.stub_internal.rna_enums import IconItems


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
    width = dialog * scale if dialog else 220 * scale if context.region is None else context.region.width
    letters = max(16, int((width / scale - 60 - taken) / 6.2))
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(american(text), letters)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1")
