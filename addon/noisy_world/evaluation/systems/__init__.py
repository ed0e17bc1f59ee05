# SPDX-License-Identifier: GPL-3.0-or-later
"""SLAM systems as data: what a definition says, and how a system is run on a sequence."""
