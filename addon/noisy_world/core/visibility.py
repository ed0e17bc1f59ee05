# SPDX-License-Identifier: GPL-3.0-or-later
"""What a visibility means, wherever a key gives one: the air's extinction (Koschmieder, 1924)."""

import math

CONTRAST_THRESHOLD = 0.05
"""The contrast of a black object that is left at this distance (WMO's meteorological optical range)."""

EXTINCTION = -math.log(CONTRAST_THRESHOLD)
"""The optical depth of air as long as its visibility."""
