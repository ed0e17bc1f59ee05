# SPDX-License-Identifier: GPL-3.0-or-later
"""From a plan to a dataset: frames are rendered once, perturbed for every setting that shows them, and written."""
