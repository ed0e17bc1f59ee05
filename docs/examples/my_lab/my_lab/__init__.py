# SPDX-License-Identifier: GPL-3.0-or-later
"""What our lab adds to Noisy World."""
