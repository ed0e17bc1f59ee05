# SPDX-License-Identifier: GPL-3.0-or-later
"""A mesh seen by rays alone, without Blender: Embree finds the triangles, numpy their colours."""
