# SPDX-License-Identifier: GPL-3.0-or-later
"""Planning: from a preset to the sequences and renders that a run makes."""
