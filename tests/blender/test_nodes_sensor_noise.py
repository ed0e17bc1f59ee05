# SPDX-License-Identifier: GPL-3.0-or-later
"""The node group of a sensor's noise: EMVA's equations in Blender, and Blender beside the same nodes on arrays."""

from dataclasses import asdict

import numpy as np
import pytest
from cases import cases
from group_tools import IDENTIFIERS, by_groups, picture, step_of

from noisy_world.nodes.compositor import Compositor
from noisy_world.perturbations.groups import socket_name
from noisy_world.perturbations.groups import build_group
from noisy_world.core.graph_arrays import carried_out, image_of
from noisy_world.perturbations import registry

SENSOR = registry()["sensor_noise"]
SIZE = (160, 200)
FLAT = {"hot_percent": 0.0, "row_noise_electrons": 0.0, "dark_electrons_per_s": 0.0}
RAW = {"subtract_black": False, "black_level": 0.25, "bits": 12}
LAST, BLACK = 4095, 1024


def in_blender(images, frames=(0,), **values):
    """What Blender makes of lit frames (H, W, 3) that are full at white, each at each index: numbers from 0 to 1."""
    chains = {"x": (step_of("sensor_noise", **({"headroom_stops": 0.0} | values)),)}
    size = images[0].shape[1], images[0].shape[0]
    with Compositor(size, chains, size[0], lit=True) as compositor:
        return [compositor.evaluate(rgb, {"x": (k, IDENTIFIERS)})[0]["x"] for rgb in images for k in frames]


def flat(light, size=SIZE):
    return np.full((*size, 3), light, np.float32)


@cases("gain_db", [0.0, 20.8, 41.6])
@cases("grain_px", [1.0, 3.0])
def test_variance_over_mean_is_emvas_line(gain_db, grain_px):
    levels = (0.0, 0.2, 0.7)
    values = {**FLAT, **RAW, "gain_db": gain_db, "grain_px": grain_px, "read_noise_electrons": 2.0}
    made = in_blender([flat(level) for level in levels], (0, 1), **values)
    gain = (LAST - BLACK) / (10_000 / 10 ** (gain_db / 20))  # K, numbers an electron
    for level, one, two in zip(levels, made[::2], made[1::2], strict=True):
        wanted = gain**2 * 2.0**2 + 1 / 12 + gain * level * (LAST - BLACK)
        found = np.square((one - two) * LAST).mean() / 2
        apart = one.size / (1 if grain_px == 1 else grain_px**2)  # numbers that are drawn by themselves
        assert found == pytest.approx(wanted, rel=0.01 + 4 * np.sqrt(2 / apart)), level
        spread = 5 * np.sqrt(wanted / apart)
        assert one.mean() * LAST == pytest.approx(BLACK + level * (LAST - BLACK), abs=spread + 0.02)


def test_a_larger_grain_is_shared_by_neighbours_and_reaches_the_border():
    values = {**FLAT, **RAW, "gain_db": 30.0, "grain_px": 4.0}
    (made,) = in_blender([flat(0.4)], **values)
    noise = made - made.mean()
    near, far = ((noise[:, :-lag] * noise[:, lag:]).mean() / noise.var() for lag in (1, 12))
    # Through a Gaussian of half its size: exp(-lag^2 / (4 sigma^2)).
    assert near == pytest.approx(np.exp(-1 / 16), abs=0.02)
    assert abs(far) < 0.1
    rim = np.concatenate([noise[:3].ravel(), noise[-3:].ravel(), noise[:, :3].ravel(), noise[:, -3:].ravel()])
    assert rim.std() == pytest.approx(noise.std(), rel=0.15), "as strong at the border"


def test_hot_pixels_stay_and_rows_are_drawn_anew():
    values = {**RAW, "dark_electrons_per_s": 0.0, "gain_db": 20.0, "read_noise_electrons": 0.0}
    hot = {"hot_percent": 2.0, "hot_electrons_per_s": 1e5, "row_noise_electrons": 0.0}  # 1,000 electrons in 10 ms
    one, two = (made * LAST - BLACK for made in in_blender([flat(0.0)], (0, 5), **values, **hot))
    gain = (LAST - BLACK) / 1000
    seen = [found > 200 * gain for found in (one, two)]
    assert seen[0].mean() == pytest.approx(0.02 * np.exp(-0.2), rel=0.2)
    assert (seen[0] & seen[1]).sum() > 0.9 * seen[0].sum()
    assert one[one > 0].mean() / gain == pytest.approx(632, rel=0.1), (
        "of an exponential law, up to a full 1,000 electrons"
    )
    rows = {"hot_percent": 0.0, "row_noise_electrons": 20.0}
    one, two = (made * LAST - BLACK for made in in_blender([flat(0.3)], (0, 5), **values, **rows))
    lines = one.mean(axis=(1, 2)) / gain - 300
    assert lines.std() == pytest.approx(20, rel=0.2)
    assert abs(np.corrcoef(lines, two.mean(axis=(1, 2)))[0, 1]) < 0.3


def test_nothing_is_negative_and_a_sensor_is_full():
    light = picture(*SIZE) ** np.float32(2.2)
    light[:9, :9] = -0.5
    for place, lamp in enumerate((4.0, 20.0, 100.0)):
        light[30:50, 10 + 50 * place : 30 + 50 * place] = lamp
    (made,) = in_blender([light], severity=5, headroom_stops=4.0)
    assert np.isfinite(made).all()
    assert made.min() == 0
    assert made.max() == pytest.approx(16)
    assert made[30:50, 110:130].min() == pytest.approx(16)
    assert made[30:50, 10:30].mean() == pytest.approx(4, rel=0.02)
    (lone,) = in_blender([flat(0.5, (1, 1))], severity=3, headroom_stops=4.0)
    assert lone.shape == (1, 1, 3)
    assert 0 < lone.mean() < 1


@cases("size", [(1, 9), (23, 37)])
@cases("given", [{}, {"grain_px": 2.5}, {"gain_db": 50.0, "hot_percent": 5.0, "subtract_black": False}])
def test_blender_makes_what_the_same_nodes_make_on_arrays(tmp_path, size, given):
    """But for numbers that lie at the border of two steps, where float32 rounds either way."""
    light = picture(*size) ** np.float32(2.2) * 3
    parameters = asdict(SENSOR.at_severity(3, **given))
    sockets = {socket_name(SENSOR, name): value for name, value in parameters.items()}
    common = {"Seed": 5, "Frame Offset": 0, "Pattern": "Fresh", "Reference Width": size[1]}
    table = {name: sockets[name] for name in (socket_name(SENSOR, item) for item in SENSOR.severities)}
    made = by_groups({"x": ("sensor_noise", sockets | table | common | {"Override Severity": True})}, light, tmp_path)[
        "x"
    ]
    graph = build_group(SENSOR, bare=True, lit=True)
    found = carried_out(graph, {"Image": light, "Enabled": True, "Encoded": False, **common, **sockets}, 5)["Image"]
    wanted = image_of(found, light.shape[:2])
    step = 16 / 2 ** parameters["bits"]
    assert np.abs(made - wanted).max() < 3 * step
    assert np.isclose(made, wanted, rtol=1e-3, atol=1e-5).mean() > 0.98
