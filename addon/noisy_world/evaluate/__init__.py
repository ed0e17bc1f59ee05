# SPDX-License-Identifier: GPL-3.0-or-later
"""What noise does to SLAM: systems run on sequences, their errors measured, and reported."""
