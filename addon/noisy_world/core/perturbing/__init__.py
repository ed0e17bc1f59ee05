# SPDX-License-Identifier: GPL-3.0-or-later
"""What a perturbation is, and what a setting does to a sequence."""
