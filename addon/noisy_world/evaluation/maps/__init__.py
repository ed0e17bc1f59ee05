# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps: fused along a path, and measured against the true scene."""
