# SPDX-License-Identifier: GPL-3.0-or-later
"""SLAM systems of our own."""
