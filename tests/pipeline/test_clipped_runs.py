# SPDX-License-Identifier: GPL-3.0-or-later
"""A run says which step makes most of a sequence's first frame white."""

import pytest
from runs import run
from worlds import write_world


@pytest.mark.usefixtures("no_blender")
def test_a_run_says_once_which_step_of_a_setting_makes_it_white(tmp_path):
    """All is as bright as can be, and then without colour; where that is left out nothing is said."""
    gentle = [{"brightness": {"offset": 1.0}}]
    white = [*gentle, {"saturate": {"gain": 0.0, "offset": 0.0}}]
    settings = [{"name": "white", "perturb": white}, {"name": "gentle", "perturb": gentle}]
    preset = write_world(tmp_path / "world", frames=2, size=(8, 6), settings=settings)
    report = run(preset, tmp_path / "out")
    (note,) = [note for note in report.notes if "white" in note]
    assert "saturate makes most" in note
