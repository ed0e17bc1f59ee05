# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's pictures, drawn by matplotlib as SVG: equal inputs give equal bytes."""
