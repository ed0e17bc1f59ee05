# SPDX-License-Identifier: GPL-3.0-or-later
"""What a bag's transforms cannot say is refused in one line that names the bag and the remedy."""

import pytest
from refusals import refused

pytest.importorskip("lz4", reason="lz4 is not installed")
pytest.importorskip("rosbags", reason="rosbags is not installed")

from noisy_world.layouts.bag_messages import Moved
from noisy_world.layouts.bag_recording import FrameTree

STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def moved(parent, child):
    """A transform at 1 ns that moves nothing."""
    return Moved(stamp_ns=1, parent=parent, child=child, values=STILL)


def test_a_frame_with_two_parents_is_refused(tmp_path):
    tree = FrameTree(tmp_path / "walk.bag")
    tree.add(moved("map", "body"), static=False)
    names = ("walk.bag: ", "body has two parents in tf: map and odom", "take one of them out of the bag")
    refused(tree.add, moved("odom", "body"), static=False, names=names)


def test_transforms_in_a_circle_are_refused(tmp_path):
    tree = FrameTree(tmp_path / "walk.bag")
    for parent, child in (("a", "b"), ("b", "c"), ("c", "a")):
        tree.add(moved(parent, child), static=True)
    refused(tree.chain, "c", names=("walk.bag: ", "tf leads round in a circle at c", "mend it"))
