# SPDX-License-Identifier: GPL-3.0-or-later
"""Making a preset's plan, with its files found and all perturbations that are installed."""

from collections.abc import Sequence

from .core.planning.plan import Plan, lay_out_plan, read_settings
from .core.planning.shards import Shard
from .core.presets.preset import Preset
from .perturbations import registry
from .sources import find_scenes


def make_plan(preset: Preset, chosen: slice | None = None, shards: Sequence[Shard] = ()) -> Plan:
    """Find every file of a preset and lay out the work.

    chosen: the frames of each sequence to make, start and stop only; they keep their numbers.
    shards: with some, the plan has their scenes alone, as a machine that makes one shard looks at no other scene.

    Raises InputError for files that are missing or wrong, and for what cannot be made from them.
    """
    settings = read_settings(preset, registry())  # first, so that a misspelt key is reported before files are read
    return lay_out_plan(preset, settings, find_scenes(preset, {shard.scene for shard in shards}), chosen)
