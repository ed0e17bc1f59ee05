# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preset draws does not hang on the last bits of a path, and datasets from before that are told apart."""

import numpy as np
import pytest
from worlds import path_poses, write_replica, write_world
from runs import run
from written import RIG

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")

from noisy_world.dataset.identity import plain_identity
from noisy_world.core.errors import StorageError
from noisy_world.sources.scene_kinds import Scene
from noisy_world.dataset.rendering import source_paths
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan

COUNT = 12
MOVED = [
    {"name": "clean"},
    {"name": "shaken", "perturb": [{"vibration": {}}, {"rolling_shutter": {}}]},
    {"name": "lone", "perturb": [{"motion_deviation": {}}]},
    {"name": "faster", "perturb": [{"faster_motion": {}}, {"camera_motion_blur": {}}]},
]


def planned(folder, shake, **keys):
    render = {"engine": "embree", "backend": "reference"}
    chosen = [item for item in MOVED if not (keys and item["name"] == "lone")]  # a clock looks between its poses
    preset = write_world(folder, frames=COUNT, size=(8, 6), render=render, settings=chosen, **keys)
    write_replica(folder / "traj.txt", path_poses(COUNT) * (1 + shake))
    return make_plan(read_preset(preset))


@pytest.mark.parametrize("keys", [{}, {"rig": {**RIG, "depth": {**RIG["depth"], "delay_ms": 4}}}])
def test_paths_and_identity_are_the_same_from_other_last_bits(tmp_path, keys):
    shake = 1e-15 * np.random.default_rng(4).choice([-1.0, 1.0], (COUNT, 4, 4))
    shake[:, 3] = 0
    chosen = [planned(tmp_path / name, by, **keys) for name, by in (("one", 0.0), ("two", shake))]
    exact = [plan.scenes[0].source.trajectory().c2w for plan in chosen]
    assert (exact[0] != exact[1]).any()
    between_s = np.linspace(0.01, 0.2, 5)
    for one, two in zip(*(plan.renders for plan in chosen), strict=True):
        for name, path in source_paths(chosen[0], one).named().items():
            other = source_paths(chosen[1], two).named()[name]
            np.testing.assert_array_equal(path.c2w, other.c2w)
            if not path.independent:
                np.testing.assert_array_equal(path.poses_at(between_s), other.poses_at(between_s))
    one, two = (plain_identity(plan, {})["scenes"]["box"]["path"] for plan in chosen)
    assert one == two


def test_a_dataset_whose_poses_were_not_rounded_does_not_grow_and_a_line_says_why(tmp_path, monkeypatch):
    render = {"engine": "embree", "backend": "reference"}
    preset = write_world(tmp_path, frames=3, size=(8, 6), render=render)
    with monkeypatch.context() as before:
        before.setattr(Scene, "path", property(lambda self: self.source.trajectory()))
        run(preset, tmp_path / "out")
    with pytest.raises(StorageError, match=r"trajectory.*rounded"):
        run(preset, tmp_path / "out")
    assert run(preset, tmp_path / "other").frames_rendered == 3
    assert run(preset, tmp_path / "other").frames_rendered == 0
