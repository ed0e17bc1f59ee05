# SPDX-License-Identifier: GPL-3.0-or-later
"""A rig's depth sensor measures every setting's depth, the clean one's too."""

import json

import cv2
import numpy as np
import pytest
from refusals import refused
from cases import cases
from runs import run
from worlds import ROOT, write_world

from noisy_world.core.geometry import Intrinsics
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.dataset.plan import read_settings
from noisy_world.preset.keys import read_preset
from noisy_world.perturbations import registry

SETTINGS = [{"name": "clean"}, {"name": "noisy", "perturb": [{"gaussian_noise": {"severity": 3}}]},
            {"name": "near", "perturb": [{"depth_range_clipping": {"min_m": 0, "max_m": 2}}]}]  # fmt: skip


def depths(folder, setting):
    files = sorted((folder / setting / "box/results").glob("depth*.png"))
    return [cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in files]


def test_every_settings_depth_is_what_the_sensor_gives(tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")
    keys = {"frames": 2, "render": {"engine": "embree", "backend": "reference"}}
    exact = write_world(tmp_path / "a", settings=SETTINGS[:1], **keys)
    run(exact, tmp_path / "exact")
    rig = {"depth": {"sensor": {"structured_light": {"min_m": 0, "max_m": 50}}}}
    run(write_world(tmp_path / "b", settings=SETTINGS, rig=rig, **keys), tmp_path / "measured")
    document = json.loads((tmp_path / "measured/clean/cam_params.json").read_text())["camera"]
    camera = Intrinsics(*(document[name] for name in ("w", "h", "fx", "fy", "cx", "cy")))
    item = registry()["structured_light"]
    seed = read_preset(exact).spec.seed
    clean, noisy, near = (depths(tmp_path / "measured", name) for name in ("clean", "noisy", "near"))
    for index, steps in enumerate(depths(tmp_path / "exact", "clean")):
        context = FrameContext(index, (seed, "box", "rig.depth", "structured_light", 0), intrinsics=camera)
        parameters = item.parameters(min_m=0, max_m=50)
        expected = item.apply((steps / 6553.5).astype(np.float32), parameters, context) * 6553.5
        # Depth was rounded here before it was measured: a value on a step's edge may fall to either side.
        assert np.mean(np.abs(clean[index] - expected) > 1) < 0.01
        np.testing.assert_array_equal(noisy[index], clean[index])
        np.testing.assert_array_equal(near[index], np.where(clean[index] > 2 * 6553.5, 0, clean[index]))
    assert any((depth != other).any() for depth, other in zip(clean, depths(tmp_path / "exact", "clean"), strict=True))
    record = json.loads((tmp_path / "measured/noisy/box/frames.jsonl").read_text().splitlines()[0])
    assert [note["name"] for note in record["perturbed"]["depth"]] == ["structured_light"]
    files = [tmp_path / f"measured/{name}/box/results/depth000000.png" for name in ("clean", "noisy")]
    assert files[0].samefile(files[1])


@cases(
    ("depth", "names"),
    [
        ({"sensor": "realsense_d434"}, ["rig.depth.sensor: ", "'realsense_d434'", "'realsense_d435'"]),
        ({"sensor": "stereo"}, ["rig.depth.sensor: stereo ", "{stereo: {}}"]),
        ({"sensor": {"fog": {}}}, "rig.depth.sensor: fog "),
        ({"sensor": 5}, ["rig.depth.sensor: ", "5"]),
        ({"sensor": {"stereo": {"sigma": 1}}}, "rig.depth.sensor.stereo.sigma: "),
        ({"sensor": "kinect_v1", "translation_m": [0, 0, 0.1]}, None),
        ({"sensor": "realsense_d435", "translation_m": [0, 0, 0.1]}, ["rig.depth.sensor: stereo ", "pose"]),
    ],
)
def test_a_sensor_is_a_device_or_a_perturbation_of_depth(depth, names):
    preset = read_preset(ROOT / "presets/demo.yaml", [f"rig={json.dumps({'depth': depth})}"])
    if names is None:
        assert {setting.depth[0].perturbation.name for setting in read_settings(preset, registry())} == {
            "structured_light"
        }
        return
    refused(read_settings, preset, registry(), names=names)


TWICE = [{"stereo": {}}, {"time_of_flight": {}}]


@cases(
    ("rig", "perturb", "names"),
    [
        (None, TWICE, ["settings.0.perturb.1: time_of_flight ", "stereo"]),
        ({"depth": {"sensor": "kinect_v1"}}, TWICE[:1], ["settings: s: stereo ", "rig.depth.sensor"]),
        (None, [{"time_of_flight": {"min_m": 4}}], ["time_of_flight: min_m is 4", "max_m, 3.86"]),
        (None, [{"structured_light": {"max_m": 0.5}}], ["structured_light: min_m is 0.8", "max_m, 0.5"]),
        (None, [{"lidar": {"max_m": 0.2}}], ["lidar: min_m is 0.5", "max_m, 0.2"]),
    ],
)
def test_depth_is_measured_once_within_a_range(tmp_path, rig, perturb, names):
    preset = write_world(tmp_path, settings=[{"name": "s", "perturb": perturb}], rig=rig)
    refused(lambda: read_settings(read_preset(preset), registry()), names=names)
    alone = read_preset(write_world(tmp_path / "b", settings=[{"name": "s", "perturb": TWICE[:1]}]))
    assert len(read_settings(alone, registry())[0].depth) == 1
