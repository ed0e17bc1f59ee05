# SPDX-License-Identifier: GPL-3.0-or-later
"""The process that imports a mesh file with Blender's importers, and writes what they made as arrays."""
