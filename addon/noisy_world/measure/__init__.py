# SPDX-License-Identifier: GPL-3.0-or-later
"""What a recording says of itself, measured on some of its frames: figures with an interval, or why there is none."""
