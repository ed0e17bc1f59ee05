# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset made on many machines: its shards as tasks of a Ray cluster, or as an array of Slurm jobs."""
