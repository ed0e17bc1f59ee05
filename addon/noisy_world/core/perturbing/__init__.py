# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations: their kinds, the steps of a setting, and carrying them out."""
