# SPDX-License-Identifier: GPL-3.0-or-later
"""Measurements: `report.py` and `perturbation_report.py` are the commands, the other modules are their parts."""
