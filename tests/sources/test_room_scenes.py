# SPDX-License-Identifier: GPL-3.0-or-later
"""The embedded rooms in presets: eight scenes from one line."""

from refusals import refused
import yaml

from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan

CAMERA = {"width": 1200, "height": 680, "fx": 600.0, "fy": 600.0, "cx": 599.5, "cy": 339.5}


def preset_of(folder, mesh, **scene):
    path = folder / "rooms.yaml"
    trajectory = {"handheld": {"frames": 2}}
    content = {"scenes": [{"mesh": mesh, "trajectory": trajectory, **scene}], "camera": CAMERA}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return read_preset(path)


def test_one_line_is_eight_scenes(tmp_path):
    plan = make_plan(preset_of(tmp_path, "embedded:room?seed=*"))
    assert [render.scene.name for render in plan.renders] == [f"room{k}" for k in range(8)]
    named = make_plan(preset_of(tmp_path, "embedded:room?seed=[24]", name="flat_*"))
    assert [render.scene.source.hashes()["mesh"] for render in named.renders] == [
        "embedded:room?seed=2",
        "embedded:room?seed=4",
    ]
    assert [render.scene.name for render in named.renders] == ["flat_2", "flat_4"]


def test_a_room_that_is_not_there_is_an_error(tmp_path):
    refused(
        make_plan,
        preset_of(tmp_path, "embedded:room?seed=9"),
        names=("scenes.0.mesh: ", "'embedded:room?seed=9'", "did you mean"),
    )
    refused(
        make_plan,
        preset_of(tmp_path, "embedded:room?seed=*", name="flat"),
        names=("scenes.0.name: ", "'flat'", "8 rooms"),
    )
