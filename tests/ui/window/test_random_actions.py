# SPDX-License-Identifier: GPL-3.0-or-later
"""Random valid actions in a Blender's window with the add-on on: no exit, no traceback, nothing of the user's changed.

The window needs NOISY_WORLD_BLENDER, as test_add_on.py does. headless/tools/random_window.py does more of the same.
"""

import os
import sys

import pytest
from worlds import ROOT

sys.path.append(str(ROOT / "headless"))

from tools.random_window import Run, run

BLENDER = os.environ.get("NOISY_WORLD_BLENDER", "")
ACTIONS = 12  # some seconds
BEGUN = [{"number": 1, "action": "use_operator", "words": ["noisy_world.add_step"]}]
DONE = {"done": 1, "result": "{'FINISHED'}", "wrong": [], "s": 0.2, "cpu_s": 0.1}
ENDED = [DONE, {"over": 1}]
ERROR = "Traceback (most recent call last):\nKeyError: 1"


@pytest.mark.long
@pytest.mark.skipif(not BLENDER, reason="NOISY_WORLD_BLENDER names no Blender program")
def test_random_actions_end_nothing_and_change_nothing_of_the_users(tmp_path):
    found = run(BLENDER, 7, 5.0, tmp_path, ACTIONS)
    assert not found.failures
    assert sum("done" in item for item in found.actions) == ACTIONS


@pytest.mark.parametrize(
    ("actions", "said", "words"),
    [
        (BEGUN, "", "ended with 11 after"),
        ([*BEGUN, DONE | {"wrong": ["object Cube"]}, {"over": 1}], "", "1: changed: object Cube"),
        ([*BEGUN, DONE | {"result": ERROR}, {"over": 1}], "", "KeyError"),
        ([*BEGUN, *ENDED], ERROR, "KeyError"),
    ],
)
def test_what_goes_wrong_in_a_run_is_told(actions, said, words):
    (failure,) = Run(7, actions, said, 11).failures
    assert words in failure


def test_a_run_without_failures_tells_what_took_longest():
    found = Run(7, [*BEGUN, *ENDED], "", 0)
    assert not found.failures
    assert list(found.slowest()) == [
        "done 0.10 s by the thread, 0.20 s: use_operator ['noisy_world.add_step']",
    ]
