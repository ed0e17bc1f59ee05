# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of a .blend in a preset: what is wrong is named before anything is opened."""

import json

import pytest

from noisy_world.core.errors import InputError
from noisy_world.core.presets.preset import read_preset
from noisy_world.planning import make_plan


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"frames": "1-5"}, r"scenes\.0\.frames: '1-5' is no range of frames; write FIRST:LAST"),
        ({"frames": "5:1"}, r"scenes\.0\.frames: '5:1' ends before it begins"),
        ({"frames": "1:5:0"}, r"scenes\.0\.frames: '1:5:0' has the step 0"),
        ({"frames": "1:9999999"}, r"beyond 1048574, Blender's last"),
        ({"mesh": "a.ply"}, r"scenes\.0: names mesh and blend, but needs one of mesh, replica,"),
        ({"blend": None, "mesh": "a.ply"}, r"scenes\.0\.frames: goes with blend; leave it out"),
        ({"trajectory": {"handheld": {"frames": 9}}}, r"trajectory\.handheld: is made through a mesh"),
        ({"trajectory": {"file": "traj.txt", "body": "walker"}}, r"trajectory\.body: needs a mesh, whose walls"),
        ({"compositor": "on"}, r"scenes\.0\.compositor: unknown value 'on'"),
        ({"depth_alpha": 2}, r"scenes\.0\.depth_alpha: is 2, out of range; allowed: 0 to 1"),
        ({"blend": "none.blend"}, r"scenes\.0\.blend: no such file: .*none\.blend"),
    ],
)
def test_keys_that_are_wrong_are_named(tmp_path, keys, message):
    scene = {"name": "hall", "blend": "hall.blend", "frames": "1:2", **keys}
    path = tmp_path / "preset.yaml"
    path.write_text(json.dumps({"scenes": [scene]}))
    with pytest.raises(InputError, match=message):
        make_plan(read_preset(path))
