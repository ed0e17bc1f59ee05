# SPDX-License-Identifier: GPL-3.0-or-later
"""A walk through an embedded room with an IMU, made once for all tests of this folder."""

import os

import pytest
import yaml
from locked import locked
from runs import run

NOISE = {"std": 0.02}
WALK = {
    "seed": 3,
    "scenes": [
        {
            "name": "room",
            "mesh": "embedded:room?seed=2",
            "trajectory": {"handheld": {"frames": 100, "rate_hz": 20, "seed": 4, "speed_m_s": 0.8}},
        }
    ],
    "camera": {"width": 240, "height": 180, "fx": 190, "fy": 190, "cx": 119.5, "cy": 89.5},
    "render": {"engine": "embree", "backend": "reference"},
    "rig": {"imu": {"device": "bmi055", "rotation_euler_deg": [10, -20, 90]}},
    "settings": [
        {"name": "clean"},
        {
            "name": "noisy",
            "perturb": [{"structured_light": {"device": "kinect_v1"}}, {"gaussian_noise": {"std": 0.02}}],
        },
    ],
    "output": {"layout": "euroc", "overview": False},
}


@pytest.fixture(scope="session")
def walk(tmp_path_factory):
    """The folder of a dataset: clean/room and noisy/room. Whichever process asks first makes it for the others too."""
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "walk"
    folder.mkdir(exist_ok=True)
    with locked(folder / "lock"):
        if not (folder / "out/run.json").exists():
            (folder / "preset.yaml").write_text(yaml.safe_dump(WALK))
            run(folder / "preset.yaml", folder / "out")
    return folder / "out"
