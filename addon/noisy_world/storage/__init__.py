# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets at an address, in an object store or wherever fsspec reaches: tars, and tables that describe them."""
