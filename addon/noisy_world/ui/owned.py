# SPDX-License-Identifier: GPL-3.0-or-later
"""How what Noisy World made in a scene is told from what a user made."""

OURS = "noisy_world"
"""A custom property of our objects and collections: "mesh", "camera", "collection", "tracking", or a part of a path."""
