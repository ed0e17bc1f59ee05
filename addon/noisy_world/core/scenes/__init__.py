# SPDX-License-Identifier: GPL-3.0-or-later
"""What is looked at: meshes, their files, and the rooms that come with Noisy World."""
