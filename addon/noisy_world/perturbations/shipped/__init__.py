# SPDX-License-Identifier: GPL-3.0-or-later
"""The perturbations that come with Noisy World, one file each: its name is the file's, a `PERTURBATION` is in it."""
