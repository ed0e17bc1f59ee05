# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of `headless/report.py`; three of them are programs that it starts."""
