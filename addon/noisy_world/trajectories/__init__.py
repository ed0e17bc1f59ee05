# SPDX-License-Identifier: GPL-3.0-or-later
"""Camera paths: poses with time stamps, their files, generated paths, and sensors on a robot."""
