# SPDX-License-Identifier: GPL-3.0-or-later
"""What is written and read: images, layouts, files that are whole or not there, and what is finished."""
