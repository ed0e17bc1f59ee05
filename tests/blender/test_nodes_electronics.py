# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups of the camera's electronics beside their executions on arrays, given what was seen before."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from cases import cases
from group_tools import IDENTIFIERS, by_groups, keep_written, levels_apart, picture, step_of
from runs import run
from many_settings import image, records
from worlds import write_world

from noisy_world.nodes.compositor import Compositor
from noisy_world.nodes.chain import decided_by
from noisy_world.perturbations.kinds import EarlierFrame, small_light
from noisy_world.perturbations.execution import ColourWork, perturb_colour
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.execution import on_light
from noisy_world.core.frame_request import Shutter

STAMP_S = 0.35
BOTH = [
    ("auto_exposure", {"light_stops": -2, "lag_s": 0.1}),
    ("flicker", {"modulation": 0.5, "readout_ms": 15.0}),
    ("white_balance", {"severity": 5, "warmth_stops": 0.5}),
]
GIVEN = {
    "grey world": [("white_balance", {"severity": 5, "lag_s": 0.0})],
    "late and wrong": [("white_balance", {"strength": 0.4, "lag_s": 0.5, "warmth_stops": 1.2, "tint_stops": -0.6})],
    "dark, gained": [("auto_exposure", {"light_stops": -5, "lag_s": 0.3})],
    "bright": [("auto_exposure", {"light_stops": 3, "lag_s": 0.1, "target": 0.4, "meter": "centre"})],
    "over white between": [
        ("auto_exposure", {"light_stops": 2, "min_ms": 10, "max_ms": 10, "max_gain_db": 0}),
        ("white_balance", {"warmth_stops": -3, "strength": 0.0}),
    ],
    "lamps": [("flicker", {"severity": 5, "readout_ms": 31.0})],
    "lamps at the automatic's exposure": [
        ("auto_exposure", {"light_stops": 1, "max_ms": 7.0}),
        ("flicker", {"mains_hz": 60, "modulation": 1.0}),
        ("white_balance", {}),
    ],
}
SHUTTERS = [Shutter(0.001, 0.003, 0.037, direction) for direction in ("down", "up", "left", "right")]
SHUTTERS += [Shutter(-0.02, 0.0, 0.03), Shutter.centred(0.013), Shutter.centred(0.02)]


def where():
    """A frame's context, with two frames before it that a meter saw."""
    dark, warm = (small_light(picture(40, 60, seed) * np.float32(scale)) for seed, scale in ((3, 0.4), (4, 0.9)))
    frames = EarlierFrame(0.0, dark), EarlierFrame(0.2, (warm * np.array([1.6, 1, 0.5])).astype(np.float32))
    return FrameContext(7, IDENTIFIERS, stamp_s=STAMP_S, read_earlier=lambda _span_s: frames)


def steps_of(items):
    return tuple(step_of(name, **values) for name, values in items)


def by_nodes(rgb, *, lit):
    """What the chains make of the frame, by name."""
    chains = {name: steps_of(items) for name, items in GIVEN.items()}
    if not lit:
        keep_written(chains)
    works = {name: ColourWork.of(steps, where()) for name, steps in chains.items()}
    size = rgb.shape[1], rgb.shape[0]
    with Compositor(size, chains, size[0], lit=lit) as compositor:
        decided = {name: decided_by(work) for name, work in works.items()}
        return works, compositor.evaluate(rgb, dict.fromkeys(chains, (7, IDENTIFIERS)), decided=decided)[0]


@cases("size", [(37, 53), (1, 7)])
def test_nodes_are_their_references_on_encoded_frames(size):
    rgb = picture(*size)
    works, made = by_nodes(rgb, lit=False)
    for name, work in works.items():
        assert levels_apart(made[name], work.on(rgb) / np.float32(255))[0] < 1, name
        if len(work.active) == 1:
            ((step, context, severity),) = work.active
            wanted = np.clip(perturb_colour(step, rgb, severity, context), 0, 1)
            assert levels_apart(made[name], wanted)[0] < 0.05, name


def test_nodes_are_their_references_on_light_of_any_brightness():
    light = picture(37, 53) ** np.float32(2.2)
    for place, lamp in enumerate((4.0, 20.0, 100.0)):
        light[10:20, 4 + 16 * place : 14 + 16 * place] = lamp
    works, made = by_nodes(light, lit=True)
    for name, work in works.items():
        wanted = on_light(work, light)
        assert wanted.max() > 3, name
        assert np.allclose(made[name], wanted, rtol=1e-3, atol=1e-6), name
        assert not np.allclose(made[name], light, rtol=0.05), name


@cases("shutter", SHUTTERS)
def test_bands_lie_where_the_shutter_has_its_lines(shutter):
    light = np.full((37, 53, 3), 0.3, np.float32)
    light[5:9, 5:9] = 100.0
    given = {"mains_hz": 50, "modulation": 0.9, "readout_ms": 12.0, "exposure_ms": 2.0}
    work = ColourWork.of((step_of("flicker", **given),), replace(where(), shutter=shutter))
    with Compositor((53, 37), {"x": steps_of([("flicker", given)])}, 53, lit=True) as compositor:
        made = compositor.evaluate(light, {"x": (7, IDENTIFIERS)}, decided={"x": decided_by(work)})[0]["x"]
    wanted = on_light(work, light)
    assert np.allclose(made, wanted, rtol=1e-3, atol=1e-6)
    assert np.allclose(wanted, light, rtol=1e-4) == (shutter.exposure_s == 0.02), "two whole turns of the lamps"


def test_an_artist_keys_what_the_automatics_would_decide(tmp_path):
    """By closed form: light times two to the power of the stops."""
    light = picture(20, 30) ** np.float32(2.2)
    light[5:10, 5:10] = 20.0
    gains = {"Red Gain": 1.5, "Green Gain": -0.25, "Blue Gain": -2.0}
    lamps = {"Swing": 0.5, "Phase": 7.25, "Bands Down": 1.5, "Bands Across": -2.0}
    nodes = {"exposed": ("auto_exposure", {"Exposure": -3.0}), "balanced": ("white_balance", gains)}
    nodes |= {"lit": ("flicker", lamps)}
    found = by_groups(nodes, light, tmp_path)
    assert np.allclose(found["exposed"], light / 8, rtol=1e-5)
    assert np.allclose(found["balanced"], light * 2.0 ** np.array(list(gains.values())), rtol=1e-5)
    down, across = (np.arange(20) + 0.5) / 20 - 0.5, (np.arange(30) + 0.5) / 30 - 0.5
    turns = 7.25 + 1.5 * down[:, None] - 2.0 * across
    wave = 1 + 0.5 * np.cos(2 * np.pi * turns)
    assert np.allclose(found["lit"], light * wave[..., None], rtol=1e-4)


def test_where_nothing_was_seen_the_group_shows_what_follows_mid_grey():
    rgb = picture(24, 32)
    step = step_of("white_balance", warmth_stops=1.0)
    grey = EarlierFrame(0.0, np.full((1, 1, 3), 0.18, np.float32))
    context = replace(step.context(where()), read_earlier=lambda _span_s: (grey,))
    with Compositor((32, 24), {"x": [step]}, 32) as compositor:
        made = compositor.evaluate(rgb, {"x": (7, IDENTIFIERS)})[0]["x"]
    assert levels_apart(made, np.clip(perturb_colour(step, rgb, None, context), 0, 1))[0] < 0.05


def test_a_dataset_of_both_backends_has_equal_frames_and_noise_of_equal_strength(tmp_path):
    """Noise is drawn by each backend itself, at the gain that auto-exposure told both."""
    noisy = [*BOTH, ("sensor_noise", {"severity": 4})]
    path = write_world(
        tmp_path / "world",
        frames=3,
        size=(64, 48),
        render={"engine": "embree"},
        output={"layout": "replica", "image": "png"},
        settings=[
            {"name": name + end, "backend": name, "stream": "one", "perturb": [{kind: given} for kind, given in steps]}
            for name in ("reference", "compositor")
            for end, steps in (("", BOTH), ("_noisy", noisy))
        ],
    )
    run(path, tmp_path / "out")
    for frame in range(3):
        arrays, nodes = (
            cv2.imread(str(image(tmp_path / "out", backend, "frame", frame))).astype(int)
            for backend in ("reference", "compositor")
        )
        assert np.abs(arrays - nodes).max() <= 1
        strength = [
            (cv2.imread(str(image(tmp_path / "out", f"{backend}_noisy", "frame", frame))) - arrays).std()
            for backend in ("reference", "compositor")
        ]
        assert strength[0] > 5
        assert strength[1] == pytest.approx(strength[0], rel=0.1)
    told = [
        [each["perturbed"]["camera"] for each in records(tmp_path / "out", name)]
        for name in ("reference", "compositor", "reference_noisy", "compositor_noisy")
    ]
    assert told[0] == told[1]
    assert told[2] == told[3]
