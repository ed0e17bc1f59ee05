# SPDX-License-Identifier: GPL-3.0-or-later
"""All code that uses bpy, apart from the add-on's windows."""
