# SPDX-License-Identifier: GPL-3.0-or-later
"""A preset's plan, with its files found and the perturbations that are installed."""

from .core.planning.plan import Plan, lay_out_plan, read_settings
from .core.presets.preset import Preset
from .perturbations import registry
from .sources import find_scenes


def make_plan(preset: Preset, chosen: slice | None = None) -> Plan:
    """Find every file of a preset and lay out the work.

    chosen: which frames of each sequence are to be made, start and stop only; they keep their numbers.

    Raises InputError for files that are missing or wrong, and for what cannot be made of them.
    """
    settings = read_settings(preset, registry())  # wrong words are told before files are looked for
    return lay_out_plan(preset, settings, find_scenes(preset), chosen)
