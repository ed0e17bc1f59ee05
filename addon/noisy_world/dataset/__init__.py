# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets: planned, made frame by frame, stored, grown, opened, and made again from recipes."""
