# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurements: `report.py` and `perturbation_report.py` are what a person starts, the rest are their parts."""
