# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a mesh or of a scene of one's own: by Blender's engines, or by rays alone, which need no Blender."""
