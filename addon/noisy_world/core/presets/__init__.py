# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preset may say, and reading it."""
