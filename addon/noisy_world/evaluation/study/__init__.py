# SPDX-License-Identifier: GPL-3.0-or-later
"""A study: systems run on the sequences of a preset or a dataset, each made when it is needed, and scored."""
