# SPDX-License-Identifier: GPL-3.0-or-later
"""What knows nothing of Blender: geometry, files, presets and datasets, on numpy alone."""
