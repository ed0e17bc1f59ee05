# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets on disk: images, layouts, atomic files, and which frames are finished."""
