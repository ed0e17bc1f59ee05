# SPDX-License-Identifier: GPL-3.0-or-later
"""A scene is built once for all its renders, and their frames are those of a scene built for each."""

import itertools
from dataclasses import replace

import pytest
from runs import files_made
from worlds import write_world

from noisy_world.render import mesh_session as blender_session
from noisy_world.dataset.rendering import source_paths
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.rendering import render_options
from noisy_world.dataset.plan import make_plan

CLEAN = {"name": "clean", "perturb": [{"fog": {"severity": 3}}]}
MOVED = [
    {"name": f"moved{k}", "perturb": [{"motion_deviation": {"rotation_deg": 3, "translation_m": 0.4 * k}}]}
    for k in (1, 2)
]


def files_of(folder, settings, shift_m):
    """Make the settings' sequences; return the bytes of their images by their place in the dataset."""
    render = {"backend": "reference", "allow_empty": True}
    keys = {"shift_m": shift_m, "settings": settings, "render": render}
    world = write_world(folder / "world", frames=3, size=(24, 18), **keys)
    files = files_made(world, folder / "out")
    return {name: data for name, data in files.items() if "/box/results/" in name}


# The middle of the second path lies between whole metres, so deviations move the origin.
@pytest.mark.parametrize(("shift_m", "most_sessions"), [((0.0, 0.0, 0.0), 1), ((20_000.43, 0.5, 0.3), 3)])
def test_frames_are_those_of_a_scene_of_their_own(tmp_path, monkeypatch, shift_m, most_sessions):
    built = []

    class Counted(blender_session.Session):
        def __init__(self, *given):
            super().__init__(*given)
            built.append(self.origin_m.tolist())

    monkeypatch.setattr(blender_session, "Session", Counted)
    together = files_of(tmp_path / "all", [CLEAN, *MOVED], shift_m)
    assert len(together) == 18
    assert 1 <= len(built) <= most_sessions
    assert all(before != after for before, after in itertools.pairwise(built)), "only for another origin"
    assert (len(built) > 1) == any(shift_m), "the second world tries what it is for"
    apart = {}
    for setting in (CLEAN, *MOVED):
        apart |= files_of(tmp_path / setting["name"], [setting], shift_m)
    assert together == apart


def test_what_another_session_is_needed_for(tmp_path):
    world = write_world(tmp_path, frames=3, size=(24, 18), settings=[CLEAN, MOVED[0]])
    plan = make_plan(read_preset(world))
    planned, moved = plan.renders
    paths = source_paths(plan, planned)
    options = render_options(plan, planned, judging=True)
    source = planned.scene.source
    told = []
    with source.prepare(planned.camera, told.append) as prepared:
        prepared.open(paths, options, told.append)
        served = prepared._session.serves
        assert served(source_paths(plan, moved), render_options(plan, moved))
        assert served(paths, replace(options, first_frames=()))
        assert not served(replace(paths, depth=paths.rgb), options)
        others = ({"channels": frozenset({"rgb"})}, {"channels": frozenset({"depth"})})
        for changed in (*others, {"samples": 2}, {"seed": 1}, {"near_m": 0.5}, {"threads": 1}):
            assert not served(paths, replace(options, **changed))
    assert told == []
