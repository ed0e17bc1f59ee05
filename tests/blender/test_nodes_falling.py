# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups of snow and rain by depth beside the execution on arrays: as much, as strong, hidden alike."""

import numpy as np
import pytest
from cases import cases
from group_tools import by_groups, by_nodes, by_reference, picture, radial_power, step_of

from noisy_world.nodes.compositor import Compositor
from noisy_world.core.geometry import Intrinsics
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.core.camera_motion import CameraMotion

NAMES = ("snow_depth", "rain_depth")
SIZE = (240, 360)


def grey(level=0.15):
    return np.full((*SIZE, 3), level, np.float32)


@cases(("name", "temporal", "quick"), [("snow_depth", "fresh", True), ("rain_depth", "drift", False)])
def test_streaks_are_as_many_as_strong_and_as_large(name, temporal, quick):
    check_streaks(name, temporal, quick)


@pytest.mark.long
@cases(
    ("name", "temporal", "quick"),
    [
        *(("snow_depth", temporal, False) for temporal in ("drift", "fresh")),
        *(("rain_depth", *item) for item in (("fresh", False), ("drift", True), ("fresh", True))),
    ],
)
def test_streaks_that_come_otherwise_are_as_many_as_strong_and_as_large(name, temporal, quick):
    check_streaks(name, temporal, quick)


def check_streaks(name, temporal, quick):
    depth_m = np.full(SIZE, 12.0, np.float32)
    values = {"severity": 5, "least_mrad": 3.0, "gusts_m_s": 0.0, "depth_m": depth_m, "temporal": temporal}
    values["coarse"] = quick
    # What drifts is the same around a camera at rest, so there each image has a seed of its own.
    seeds, frames = ((7,), range(6)) if temporal == "fresh" else (range(8), (0,))
    found, wanted = (
        np.array(
            [image for k in seeds for image in make(name, grey(), frames, identifiers=(k, "room", "setting"), **values)]
        )
        for make in (by_nodes, by_reference)
    )
    change = [item.mean() - 0.15 for item in (found, wanted)]
    assert change[0] == pytest.approx(change[1], rel=0.05)
    powers = [sum(radial_power(image - image.mean(), bands=8) for image in item) for item in (found, wanted)]
    assert np.abs(np.log(powers[0][3:] / powers[1][3:])).max() < np.log(1.35)


@cases("name", NAMES)
def test_the_veil_is_the_reference_s_and_nothing_is_seen_before_what_is_nearer(name):
    depth_m = np.repeat(np.geomspace(0.19, 400, SIZE[0], dtype=np.float32)[:, None], SIZE[1], axis=1)
    depth_m[:9] = 0
    # Of particles that are nearly points none is drawn.
    values = {"severity": 5, "size": 0.05, "least_mrad": 100.0, "rate_mm_h": 500.0, "depth_m": depth_m}
    image = np.random.default_rng(1).random((*SIZE, 3), dtype=np.float32)
    (found,), (wanted,) = (make(name, image, **values) for make in (by_nodes, by_reference))
    assert np.abs(found - wanted).max() < 1e-3
    depth_m[:] = 0.2
    (hidden,) = by_nodes(name, grey(), severity=5, least_mrad=2.0, depth_m=depth_m)
    assert np.ptp(hidden) < 1e-4


@cases("name", NAMES)
def test_what_is_brighter_than_white_comes_through(name, tmp_path):
    """A group in an artist's compositor, in linear light, its Depth one number, before lamps of 4, 20 and 100."""
    light = np.full((24, 36, 3), 0.2, np.float32)
    light[4:8, 4:8], light[10:14, 4:8], light[16:20, 4:8] = 4, 20, 100
    near, far = by_groups({f"{z}": (name, {"Depth": z}) for z in (0.01, 3.0)}, light, tmp_path).values()
    for found, apart in ((near, 1e-4), (far, 0.2)):
        for row, value in ((5, 4), (11, 20), (17, 100)):
            assert found[row, 5] == pytest.approx([value] * 3, rel=apart)
    assert np.ptp(far[:, 12:]) > 1e-4  # and it falls


def test_a_known_camera_decides_the_field_of_view():
    depth_m = np.full((24, 36), 3.0, np.float32)
    camera = Intrinsics(36, 24, 30.0, 30.0, 17.5, 11.5)
    wide_deg = np.degrees(2 * np.arctan(18 / 30))
    made = []
    for view_deg, known in ((wide_deg, None), (90.0, camera), (90.0, None)):
        chains = {"x": [step_of("snow_depth", severity=5, view_deg=view_deg)]}
        with Compositor((36, 24), chains, 36, known) as compositor:
            made.append(compositor.evaluate(grey()[:24, :36], {"x": (0, (7, "room", "s"))}, depth_m)[0]["x"])
    assert np.array_equal(made[0], made[1])
    assert not np.array_equal(made[1], made[2])


def moving(velocity_m_s, turning_rad_s):
    """The motion of a level camera, whose world's axes are its own."""
    return CameraMotion(np.eye(4), np.eye(4), np.array(velocity_m_s), np.array(turning_rad_s))


MOTIONS = {
    "at rest": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "aside": ((12.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "on": ((0.0, 0.0, 15.0), (0.0, 0.0, 0.0)),
    "turning": ((0.0, 0.0, 0.0), (0.0, 1.5, 0.0)),
    "rolling": ((0.0, 0.0, 0.0), (0.0, 0.0, 8.0)),
}


def slants(image):
    """In quarters of the image: which way streaks lie (-1 to 1: across, along; and the diagonals)."""
    rows, columns = np.gradient(image.mean(axis=-1).astype(np.float64))
    down, right = SIZE[0] // 2, SIZE[1] // 2
    found = []
    for part in ((slice(None, down), slice(None, right)), (slice(down, None), slice(right, None))):
        x, y = columns[part], rows[part]
        energy = (x * x + y * y).sum()
        found += [(x * x - y * y).sum() / energy, 2 * (x * y).sum() / energy]
    return np.array(found)


def test_streaks_follow_the_camera_s_motion():
    """Fine rain, so that many streaks are seen; by both executions they lie alike, and not as for a camera at rest."""
    depth_m = np.full(SIZE, 12.0, np.float32)
    step = step_of("rain_depth", severity=5, least_mrad=4.0, gusts_m_s=0.0, shutter_ms=8.0, temporal="drift")
    made = {}
    with Compositor((SIZE[1], SIZE[0]), {"x": [step]}, SIZE[1]) as compositor:
        for name, motion in MOTIONS.items():
            found = []
            for k in range(3):
                where, frame = moving(*motion), (k * 37, (7, "room", "s"))
                nodes = compositor.evaluate(grey(), {"x": frame}, depth_m, {"x": where})[0]["x"]
                context = step.context(FrameContext(*frame, motion=where, read_depth_m=lambda: depth_m))
                arrays = step.perturbation.apply(grey(), step.parameters(5), context)
                found.append((slants(nodes), slants(arrays), nodes.mean() - 0.15, arrays.mean() - 0.15))
            made[name] = [np.mean(part, axis=0) for part in zip(*found, strict=True)]
    for name, (nodes, arrays, change, wanted) in made.items():
        assert np.abs(nodes - arrays).max() < 0.2, (name, nodes, arrays)
        assert change == pytest.approx(wanted, rel=0.05), name
        if name != "at rest":
            assert np.abs(arrays - made["at rest"][1]).max() > 0.3, name


def test_a_sky_that_is_very_far_is_as_void():
    image, void = picture(30, 40), np.full((30, 40), 5.0, np.float32)
    void[:15] = 0
    sky = np.where(void > 0, void, np.float32(1e10))
    found = [by_nodes("snow_depth", image, depth_m=depth_m, severity=3)[0] for depth_m in (void, sky)]
    assert np.array_equal(*found)
