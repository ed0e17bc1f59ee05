# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes: meshes, their files, and the room that comes with Noisy World."""
