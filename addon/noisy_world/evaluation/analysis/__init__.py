# SPDX-License-Identifier: GPL-3.0-or-later
"""What the runs of systems say together: intervals, tests, correlations, indicators, a prediction of failure."""
