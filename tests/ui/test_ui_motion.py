# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tab draws of motion: a perturbation's path and spectrum, and the body that carries the camera."""

from types import SimpleNamespace

import numpy as np
import pytest
from cases import cases

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

from noisy_world.trajectories.bodies import BODIES
from noisy_world.perturbations.shipped._deviations import SPECTRA
from noisy_world.panel import drawn_paths, sections
from noisy_world.panel.step_list import add_step

pytestmark = pytest.mark.usefixtures("add_on")


def panel():
    return bpy.context.scene.noisy_world


def added(name):
    add_step(panel(), name)
    return next(step for step in panel().steps if step.perturbation == name)


def test_the_plotted_signals_have_the_source_s_power():
    moved_m, turned_deg = sections.signals(panel(), added("vibration"))
    walk = SPECTRA["walk"]
    # Of 8 s: the mean over the axes, to within what so short a time tells.
    for values, axes in ((moved_m, walk.translation_m), (turned_deg, walk.rotation_deg)):
        wanted = np.sqrt(sum(axis.rms**2 for axis in axes))
        assert np.sqrt((values**2).sum(axis=1).mean()) == pytest.approx(wanted, rel=0.35)
    hz, density = sections.power(moved_m, 500.0)
    inside = (hz > 1.5) & (hz < 2.5)
    assert density[inside, 1].sum() > 0.9 * density[:, 1].sum()  # down: 97 % at the steps' two a second
    # Parseval: the density adds up to the variance.
    tone = np.sin(2 * np.pi * 20 * np.arange(4000) / 500.0)[:, None] * [1.0, 0.0, 2.0]
    hz, density = sections.power(tone, 500.0)
    np.testing.assert_allclose(density.sum(axis=0) * (hz[1] - hz[0]), [0.5, 0.0, 2.0], rtol=0.01, atol=1e-12)


@cases("name", ["vibration", "drift", "jerk"])
def test_each_has_a_picture_that_follows_its_values(name):
    step = added(name)
    window = sections.window_of(name)[1:]
    first = sections.picture(*sections.signals(panel(), step), *window)
    assert first.shape == (384, 384, 3)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 10  # lines and letters
    panel().seed += 1
    assert (sections.picture(*sections.signals(panel(), step), *window) != first).any()


def test_others_have_none(monkeypatch):
    for name in ("fog", "motion_deviation", "faster_motion"):
        sections.draw_motion(SimpleNamespace(), panel(), added(name))  # which would fail where it drew
    drawn = []
    monkeypatch.setattr(sections, "_icon", lambda *_: 7)
    layout = SimpleNamespace(template_icon=lambda **given: drawn.append(given["icon_value"]))
    sections.draw_motion(layout, panel(), added("vibration"))
    assert drawn == [7]


def path(count=5):
    """A camera 1 m up, which goes along x and looks along y."""
    c2w = np.tile(np.eye(4), (count, 1, 1))
    c2w[:, :3, :3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    c2w[:, 0, 3], c2w[:, 2, 3] = np.arange(count), 1.0
    return c2w


@cases("kind", list(BODIES))
def test_a_body_stands_below_its_camera(kind):
    panel().scene.trajectory.use_body = True
    panel().scene.trajectory.body.kind = kind
    c2w = path()
    outlines = [ends for colour, ends in drawn_paths.lines(panel(), c2w, 2, c2w[2]) if colour == drawn_paths.BODY_RGB]
    outline, shadow = outlines
    floor_m = 1.0 - BODIES[kind].height_m
    assert outline[:, 2].min() == pytest.approx(floor_m)
    assert np.abs(outline[:, :2] - [2.0, 0.0]).max() < 0.45
    assert outline[:, 2].max() >= 1.0 - 1e-9
    assert shadow[:, 2] == pytest.approx(floor_m)
    np.testing.assert_allclose(shadow[[0, -1], 0], [0, 4])
    assert len(outline) % 2 == len(shadow) % 2 == 0


def test_the_rig_sits_on_the_camera_with_its_deviation():
    assert drawn_paths.lines(panel(), path(), 0, path()[0]) == []
    panel().rig.imu.translation_m = (0.1, 0.0, 0.3)
    moved = path()[3]
    moved[:3, 3] = (3.0, 0.05, 1.1)
    found = drawn_paths.lines(panel(), path(), 3, moved)
    assert [len(ends) for _, ends in found] == [2] * 6
    np.testing.assert_allclose(found[0][1], [[3.0, 0.05, 1.1], [3.2, 0.05, 1.1]], atol=1e-6)
    # The IMU: .1 m to the right, which is the world's x, and .3 m ahead, its y.
    np.testing.assert_allclose(found[3][1][0], [3.1, 0.35, 1.1], atol=1e-6)
    np.testing.assert_allclose(found[5][1][1] - found[5][1][0], [0, drawn_paths.IMU_AXIS_M, 0], atol=1e-6)


def test_the_current_frame_is_the_pose_that_is_shown():
    scene = bpy.context.scene
    for frame, row in ((0, 0), (3, 3), (9, 4)):
        scene.frame_set(frame)
        assert drawn_paths.current_row(scene, 5) == row
