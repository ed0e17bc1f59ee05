# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line `noisy-world`: a module for each subcommand, which the scripts in `headless/` start as well."""
