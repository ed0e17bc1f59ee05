# SPDX-License-Identifier: GPL-3.0-or-later
"""Handing out work: shards of a dataset and sequences of a study, to processes here or on many machines."""
