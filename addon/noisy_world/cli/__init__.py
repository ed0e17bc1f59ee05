# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line `noisy-world`: a module for each subcommand; the scripts in `headless/` run the same modules."""
