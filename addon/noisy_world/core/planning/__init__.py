# SPDX-License-Identifier: GPL-3.0-or-later
"""From a preset to what is to be done."""
