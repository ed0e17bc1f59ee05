# SPDX-License-Identifier: GPL-3.0-or-later
"""Node groups in Blender: built from descriptions, evaluated on arrays, and shown on the timeline."""
