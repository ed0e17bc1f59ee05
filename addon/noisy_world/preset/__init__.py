# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets: the keys that they may have, and reading them."""
