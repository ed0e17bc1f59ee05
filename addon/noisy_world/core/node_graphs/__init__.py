# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations of colour as node groups: described as arithmetic, before Blender makes them."""
