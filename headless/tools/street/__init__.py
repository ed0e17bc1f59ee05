# SPDX-License-Identifier: GPL-3.0-or-later
"""A street at dusk after rain: a lit scene of this project's own, made of primitives and procedural materials alone."""
