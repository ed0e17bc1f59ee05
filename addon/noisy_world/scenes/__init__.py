# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes: meshes, their files, and what a .blend says of itself."""
