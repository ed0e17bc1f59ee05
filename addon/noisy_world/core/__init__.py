# SPDX-License-Identifier: GPL-3.0-or-later
"""Everything that needs no Blender: geometry, files, presets and datasets, with numpy alone."""
