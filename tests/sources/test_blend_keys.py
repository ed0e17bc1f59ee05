# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a .blend in a preset: what is wrong is named before anything is opened."""

import json

import pytest
from refusals import refused

from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"frames": "1-5"}, ("scenes.0.frames: ", "'1-5'", "write FIRST:LAST")),
        ({"frames": "5:1"}, ("scenes.0.frames: ", "'5:1' ends")),
        ({"frames": "1:5:0"}, ("scenes.0.frames: ", "'1:5:0'", "step 0")),
        ({"frames": "1:9999999"}, "beyond 1048574"),
        ({"mesh": "a.ply"}, ("scenes.0: names mesh and blend", "one of mesh, replica,")),
        ({"blend": None, "mesh": "a.ply"}, ("scenes.0.frames: ", "goes with blend", "leave it out")),
        ({"trajectory": {"handheld": {"frames": 9}}}, ("trajectory.handheld: ", "mesh")),
        ({"trajectory": {"file": "traj.txt", "body": "walker"}}, ("trajectory.body: ", "needs a mesh")),
        ({"compositor": "on"}, ("scenes.0.compositor: ", "'on'")),
        ({"depth_alpha": 2}, ("scenes.0.depth_alpha: ", "is 2", "0 to 1")),
        ({"air": {"soften_sun": "yes"}}, "scenes.0.air.soften_sun: "),
        ({"air": {"visibility_m": 0}}, ("scenes.0.air.visibility_m: ", "is 0")),
        ({"air": {"path_m": -1}}, ("scenes.0.air.path_m: ", "is -1")),
        ({"blend": None, "mesh": "a.ply", "frames": None, "air": {}}, ("scenes.0.air: ", "goes with blend")),
        ({"blend": "none.blend"}, ("scenes.0.blend: no such file: ", "none.blend")),
    ],
)
def test_keys_that_are_wrong_are_named(tmp_path, keys, message):
    scene = {"name": "hall", "blend": "hall.blend", "frames": "1:2", **keys}
    path = tmp_path / "preset.yaml"
    path.write_text(json.dumps({"scenes": [scene]}))
    refused(lambda: make_plan(read_preset(path)), names=message)
