# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a camera goes: poses with time stamps, their files, paths made here, sensors on a robot."""
