# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of a preset, for scripts: `make_plan`."""

from .dataset.plan import make_plan

__all__ = ["make_plan"]
