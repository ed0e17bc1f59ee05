# SPDX-License-Identifier: GPL-3.0-or-later
"""What every group has: light of any brightness, severity, mask, pattern, clipping and panels, as people use them."""

import bpy
import numpy as np
import pytest
from cases import cases
from group_tools import IDENTIFIERS, by_groups, keep_group, picture, step_of

from noisy_world.blender.compositor import Compositor
from noisy_world.blender.nodes import ensure_group, remove_group
from noisy_world.core.node_graphs.chain import build_chain, shown_values
from noisy_world.core.node_graphs.groups import build_group
from noisy_world.core.perturbing.kinds import ColourPerturbation
from noisy_world.perturbations import registry

COLOUR = {item.name: item for item in registry().values() if isinstance(item, ColourPerturbation)}
TABLED = [name for name, item in COLOUR.items() if item.severities]
LAMPS = (4.0, 20.0, 100.0)
HEIGHT, WIDTH = 30, 64


@pytest.fixture(scope="module", autouse=True)
def groups():
    for name in COLOUR:
        keep_group(name)


def lit():
    """Scene-linear light (H, W, 3) with three lamps of 10 x 10 pixels, and something darker than black."""
    rgb = picture(HEIGHT, WIDTH) ** 2.2
    for place, light in enumerate(LAMPS):
        rgb[10:20, 6 + 20 * place : 16 + 20 * place] = light
    rgb[0, 0] = -0.01
    return rgb.astype(np.float32)


def depth():
    """Planar depth (H, W), metres, with void."""
    depth_m = np.tile(np.linspace(0.5, 6, WIDTH, dtype=np.float32), (HEIGHT, 1))
    depth_m[:3, :3] = 0
    return depth_m


def decoded(encoded):
    """Linear light by IEC 61966-2-1, beyond [0, 1] by the same formulas."""
    power = ((np.maximum(encoded, 0).astype(np.float64) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, power)


def encoded(light):
    power = 1.055 * np.maximum(light, 0).astype(np.float64) ** (1 / 2.4) - 0.055
    return np.where(light <= 0.0031308, 12.92 * light, power)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Every group on the lamps: switched off, at severities 0, 1 and 3, and clipped at 3."""
    options = {
        "off": {"Enabled": False},
        "none": {"Severity": 0.0},
        "low": {"Severity": 1.0},
        "middle": {},
        "clipped": {"Clip": True},
    }
    nodes = {
        f"{name} {label}": (name, values)
        for name, item in COLOUR.items()
        for label, values in options.items()
        if item.severities or "Severity" not in values
    }
    return by_groups(nodes, lit(), tmp_path_factory.mktemp("lamps"), depth_m=depth())


@cases("name", COLOUR)
def test_light_of_any_brightness_comes_through(made, name):
    rgb = lit()
    assert np.array_equal(made[f"{name} off"], rgb)
    if f"{name} none" in made:
        assert np.array_equal(made[f"{name} none"], rgb)
    for label in ("low", "middle"):
        found = made.get(f"{name} {label}")
        assert found is None or np.isfinite(found).all(), label
    found = made[f"{name} low"] if name in TABLED else made[f"{name} middle"]
    # Means of the lamps' middles: what blurs or weather leave of them is still brighter than white, and in order.
    means = [found[13:17, 9 + 20 * place : 13 + 20 * place].mean() for place in range(3)]
    assert 1 < means[0] < means[1] < means[2], means
    clipped = made[f"{name} clipped"]
    assert clipped.min() >= 0
    assert clipped.max() <= 1 + 1e-4  # the encoding's round trip


def lamp_of(made, name, label="middle"):
    """The brightest pixel in the middle of the lamp of 100."""
    return made[f"{name} {label}"][14:16, 50:52]


def test_a_lamp_of_100_is_as_bright_as_the_definitions_say(made):
    """By the formulas on encoded values, written again: exact ones at 1e-3, others within what they may change."""
    lamp = encoded(np.array(100.0))
    brighter = decoded(lamp + COLOUR["brightness"].at_severity(3).offset)
    assert np.abs(lamp_of(made, "brightness") / brighter - 1).max() < 1e-3
    seen = COLOUR["fog"].at_severity(3)
    low, high = (decoded((lamp + share * seen.thickness) / (1 + seen.thickness)) for share in (0, 1))
    assert low * 0.99 < lamp_of(made, "fog").min() <= lamp_of(made, "fog").max() < high * 1.01
    ice = COLOUR["frost"].at_severity(3)
    low, high = (decoded(lamp * ice.intensity + share * ice.influence) for share in (0, 1))
    assert low * 0.99 < lamp_of(made, "frost").min() <= lamp_of(made, "frost").max() < high * 1.01
    # JPEG quantises it as it does what is darker: the error is of the size of the tables' steps.
    assert np.abs(encoded(lamp_of(made, "jpeg_compression")) - lamp).max() < 0.2
    impulses = made["impulse_noise middle"]
    lamp_of_100, dark = impulses[10:20, 46:56], impulses[22:]
    assert np.abs(lamp_of_100[lamp_of_100 > 0] - 100).max() < 0.01  # salt is white, and this is brighter already
    assert 0 < (lamp_of_100 == 0).sum() < 40  # pepper, of 300
    assert {0.0, 1.0} < set(np.round(dark, 4).ravel())
    photons = encoded(made["shot_noise middle"][10:20, 46:56]) * COLOUR["shot_noise"].at_severity(3).photons
    assert np.abs(photons - np.round(photons)).max() < 0.02
    assert abs(photons.mean() - 12 * lamp) < 5 * np.sqrt(12 * lamp / photons.size)


def test_a_whole_severity_gives_the_parameters_of_the_table_to_the_bit(tmp_path):
    rgb, depth_m = picture(HEIGHT, WIDTH), depth()
    steps = {f"{name} {level}": step_of(name, severity=level) for name in TABLED for level in (2, 5)}
    shown = {label: shown_values(step, 5, IDENTIFIERS, scene_frame=5) for label, step in steps.items()}
    assert all(values["Severity"] == steps[label].severity for label, values in shown.items())
    common = {"Encoded": True, "Clip": True}
    nodes = {label: (steps[label].perturbation.name, values | common) for label, values in shown.items()}
    found = by_groups(nodes, rgb, tmp_path, depth_m=depth_m)
    with Compositor((WIDTH, HEIGHT), {label: [step] for label, step in steps.items()}, WIDTH) as compositor:
        wanted, _ = compositor.evaluate(rgb, dict.fromkeys(steps, (5, IDENTIFIERS)), depth_m)
    assert [label for label in steps if not np.array_equal(found[label], wanted[label])] == []


def test_a_severity_between_levels_is_between_them_and_less_than_1_fades_out(tmp_path):
    rgb = lit()
    nodes = {f"{severity}": ("contrast", {"Severity": severity}) for severity in (0.25, 1.0, 2.0, 2.25, 3.0)}
    by_hand = {"Override Severity": True, "Factor": COLOUR["contrast"].at_severity(2.25).factor, "Severity": 0.5}
    found = by_groups(nodes | {"by hand": ("contrast", by_hand)}, rgb, tmp_path)
    assert np.allclose(found["0.25"], 0.75 * rgb + 0.25 * found["1.0"], rtol=1e-5, atol=1e-5)
    assert np.allclose(found["2.25"], found["by hand"], rtol=1e-5, atol=1e-6)  # where Severity has no say
    assert not np.allclose(found["2.25"], found["2.0"], rtol=1e-3)


def test_a_mask_says_where_the_effect_shows(tmp_path):
    rgb = lit()
    mask = np.zeros((HEIGHT, WIDTH), np.float32)
    mask[:, 20:40], mask[:, 40:] = 0.5, 1.0
    for name in ("contrast", "snow_depth"):  # which work on encoded colour, and on light
        nodes = {"whole": (name, {}), "masked": (name, {"Mask": mask}), "half": (name, {"Mask": 0.5})}
        found = by_groups(nodes, rgb, tmp_path, depth_m=depth())
        assert np.array_equal(found["masked"][:, :20], rgb[:, :20])
        assert np.array_equal(found["masked"][:, 40:], found["whole"][:, 40:])
        assert np.array_equal(found["masked"][:, 20:40], found["half"][:, 20:40])
        assert np.allclose(found["half"], (rgb + found["whole"]) / 2, rtol=1e-5, atol=1e-5)


def test_a_chain_clips_as_the_generator_does_unless_it_is_told_not_to(tmp_path):
    rgb = lit()
    chain = build_chain("Chain", [step_of("fog_depth", severity=1), step_of("brightness", severity=1)])
    found = by_groups({"on": (chain, {}), "off": (chain, {"Clip": False})}, rgb, tmp_path, depth_m=depth())
    assert found["on"].max() <= 1 + 1e-4
    assert found["off"][15, 11].min() > 1
    dark = (found["off"] < 0.99).all(axis=2)
    assert np.allclose(found["on"][dark], np.maximum(found["off"][dark], 0), atol=1e-5)


def test_a_pattern_is_fresh_fixed_or_drifts(tmp_path):
    rgb = lit()
    names = ("Fresh", "Fixed", "Drift")
    nodes = {item: ("fog", {"Pattern": item, "Seed": 3}) for item in names} | {"default": ("fog", {"Seed": 3})}
    first, later = (by_groups(nodes, rgb, tmp_path, frame=frame) for frame in (0, 7))
    assert np.array_equal(first["Fixed"], later["Fixed"])
    assert np.array_equal(first["Drift"], first["Fixed"])  # at the first frame
    assert not np.array_equal(later["Drift"], later["Fixed"])
    assert not np.array_equal(later["Fresh"], later["Fixed"])
    assert np.array_equal(later["default"], later["Drift"])


def test_the_node_s_sockets_stand_in_panels():
    tree = ensure_group(build_group(COLOUR["fog"]))
    sockets = [item for item in tree.interface.items_tree if item.item_type == "SOCKET" and item.in_out == "INPUT"]
    panels = {}
    for item in sockets:
        panels.setdefault(item.parent.name, []).append(item.name)
    assert panels == {
        "": ["Image", "Mask", "Severity", "Enabled", "Uniform", "Flow"],
        "Override Severity": ["Override Severity", "Thickness", "Smoothness"],
        "Random Pattern": ["Pattern", "Seed", "Frame Offset"],
        "Image Options": ["Reference Width", "Encoded", "Clip"],
    }
    assert [item.name for item in sockets if item.is_panel_toggle] == ["Override Severity"]
    closed = [item.name for item in tree.interface.items_tree if item.item_type == "PANEL" and item.default_closed]
    assert closed == ["Image Options"]
    assert tree.default_group_node_width > 150


def test_a_user_s_own_group_of_the_same_name_is_neither_taken_nor_replaced():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    theirs = bpy.data.node_groups.new("Contrast", "CompositorNodeTree")
    theirs.use_fake_user = True
    ours = ensure_group(build_group(COLOUR["contrast"]))
    assert (theirs.name, len(theirs.nodes)) == ("Contrast", 0)
    assert ours.name == "Contrast.001"
    assert ensure_group(build_group(COLOUR["contrast"])) == ours
    copied = ours.copy()  # a user's, to be changed
    copied.nodes.clear()
    assert ensure_group(build_group(COLOUR["contrast"])) == ours
    remove_group(ours)
    again = ensure_group(build_group(COLOUR["contrast"]))
    assert again not in (theirs, copied)
    assert len(copied.nodes) == 0
