# SPDX-License-Identifier: GPL-3.0-or-later
"""Marks data that Noisy World made in a scene, to tell it from the user's."""

OURS = "noisy_world"
"""A custom property of our objects and collections: "mesh", "camera", "collection", "tracking", or a part of a path."""
