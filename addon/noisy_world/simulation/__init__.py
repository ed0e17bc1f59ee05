# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies with mass and contacts that follow a route over a floor, simulated by MuJoCo; it comes with an extra."""
