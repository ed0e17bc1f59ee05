# SPDX-License-Identifier: GPL-3.0-or-later
"""What builds and draws for the project itself: the extension's zips, the asset library, the docs' pictures."""
