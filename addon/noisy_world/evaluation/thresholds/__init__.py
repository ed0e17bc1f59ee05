# SPDX-License-Identifier: GPL-3.0-or-later
"""Thresholds: the value of a perturbation at which a system's success falls to one half."""
