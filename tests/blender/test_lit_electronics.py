# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera's electronics on lit frames: light before the view transform, with what is brighter than white."""

import json

import bpy
import cv2
import numpy as np
import pytest

from own_scenes import new_scene, save
from runs import run


STOPS = -5
EXPOSED = {"light_stops": STOPS, "min_ms": 10.0, "max_ms": 10.0, "max_gain_db": 0.0}  # nothing makes up for it
QUIET = {"gain_db": 0.0, "full_well_electrons": 1e6, "bits": 16, "hot_percent": 0.0, "row_noise_electrons": 0.0}
BOTH = [{"auto_exposure": {"light_stops": -2, "lag_s": 0.1}}, {"white_balance": {"severity": 5, "warmth_stops": 0.5}}]
SETTINGS = [
    {"name": "clean"},
    {"name": "dark", "perturb": [{"auto_exposure": EXPOSED}]},
    {"name": "sensor", "perturb": [{"sensor_noise": {**QUIET, "headroom_stops": 7.0}}]},
    {"name": "full", "perturb": [{"sensor_noise": {**QUIET, "headroom_stops": 0.0}}]},
    {"name": "settled", "perturb": [{"auto_exposure": {}}]},
    {"name": "arrays", "perturb": BOTH},
    {"name": "nodes", "perturb": BOTH, "backend": "compositor"},
]


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """By setting, of a hall with a lamp of a hundred times white, shown by the Standard view."""
    folder = tmp_path_factory.mktemp("lit")
    scene = new_scene(samples=2)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.3, location=(0, 3, 0.6))
    material = bpy.data.materials.new("Lamp")
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Emission Color"].default_value = (1, 1, 1, 1)
    shader.inputs["Emission Strength"].default_value = 100.0
    bpy.context.object.data.materials.append(material)
    scene.view_settings.view_transform = "Standard"
    scene.frame_end = 2
    save(folder, "lit")
    (folder / "lit.yaml").write_text(
        "scenes: [{name: hall, blend: lit.blend}]\n"
        f"settings: {json.dumps(SETTINGS)}\n"
        "render: {backend: reference}\noutput: {image: png, modalities: [rgb]}\n"
    )
    run(folder / "lit.yaml", folder / "out")
    return {
        setting["name"]: cv2.imread(str(folder / f"out/{setting['name']}/hall/results/frame000001.png"))[..., ::-1]
        for setting in SETTINGS
    }, folder


def test_a_lamp_stays_white_where_all_else_goes_dark(images):
    made, _ = images
    lamp = (made["clean"] == 255).all(axis=2) & (made["dark"] == 255).all(axis=2)
    assert lamp.sum() > 20, "a hundred times white over 32 is white"
    rest = cv2.dilate(lamp.astype(np.uint8), np.ones((5, 5))) == 0
    linear = [((image[rest] / 255 + 0.055) / 1.055) ** 2.4 for image in (made["clean"], made["dark"])]
    bright = (made["clean"][rest] > 100) & (made["clean"][rest] < 250)
    assert bright.sum() > 20
    found = np.median(linear[1][bright] / linear[0][bright])
    assert found == pytest.approx(2**STOPS, rel=0.25), "8 bits are coarse in the dark"


def test_a_quiet_sensor_with_headroom_changes_next_to_nothing(images):
    made, _ = images
    assert np.abs(made["sensor"].astype(int) - made["clean"]).mean() < 0.6
    assert np.abs(made["full"].astype(int) - made["clean"]).mean() < 0.6, "full at white is what this view shows"


def test_the_record_says_what_was_metered(images):
    _, folder = images
    line = (folder / "out/settled/hall/frames.jsonl").read_text().splitlines()[1]
    camera = json.loads(line)["perturbed"]["camera"]
    assert 0.05 <= camera["exposure_ms"] <= 33.0
    assert camera["gain_db"] >= 0.0


def test_nodes_are_told_what_was_metered(images):
    made, folder = images
    assert np.abs(made["nodes"].astype(int) - made["arrays"]).max() <= 1
    assert np.abs(made["nodes"].astype(int) - made["clean"]).mean() > 3
    told = [
        [json.loads(line)["perturbed"] for line in (folder / f"out/{name}/hall/frames.jsonl").read_text().splitlines()]
        for name in ("nodes", "arrays")
    ]
    assert [each["camera"] for each in told[0]] == [each["camera"] for each in told[1]]
    assert {"exposure_ms", "gain_db", "red_gain", "green_gain", "blue_gain"} == set(told[0][0]["camera"])
