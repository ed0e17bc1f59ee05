# SPDX-License-Identifier: GPL-3.0-or-later
"""Inertial measurement units: what they measure along a path, and by which errors."""
