# SPDX-License-Identifier: GPL-3.0-or-later
"""rgbd_odometry: the SLAM system that comes with Noisy World, of OpenCV's RGB-D odometry with keyframes.

It is given frames, never the true poses, and says of each frame whether it knows where it was.
"""
