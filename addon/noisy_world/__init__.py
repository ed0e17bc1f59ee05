# SPDX-License-Identifier: GPL-3.0-or-later
"""Noisy World: clean 3D scenes in, noisy RGB-D worlds out."""
