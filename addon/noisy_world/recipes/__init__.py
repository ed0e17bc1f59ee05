# SPDX-License-Identifier: GPL-3.0-or-later
"""Recipes: what makes a dataset, and the digests by which it is known; datasets and recipes opened frame by frame."""
