# SPDX-License-Identifier: GPL-3.0-or-later
"""Rain and snow that drift stay in the world: a camera that moves and turns sees each particle where geometry says."""

from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest
from cases import cases
from group_tools import step_of
from scipy.spatial.transform import Rotation

from srgb import linear
from noisy_world.nodes.compositor import Compositor
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.core.camera_motion import motion_between
from noisy_world.perturbations.shipped.snow_depth import LAWS

SIZE = (150, 220)
IDENTIFIERS = (7, "room", "setting")
LEVEL, RATE_HZ = 0.15, 24.0
FOCAL_PX = SIZE[1] / 2  # of a horizontal field of 90 degrees
MIDDLE_PX = np.array([(SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2])
STILL_AIR = {"fall": 0.0, "wind_m_s": 0.0, "gusts_m_s": 0.0, "shutter_ms": 0.1, "aperture_mm": 0.0, "least_mrad": 6.0}


class Seen:
    """What passes the particles nearer than a wall, by an execution, for a camera at a pose."""

    def __init__(self, execution, compositor, step):
        self.execution, self.compositor, self.step = execution, compositor, step

    def __call__(self, index, first, before, now, wall_m):
        motion, image = motion_between(first, before, now, 1 / RATE_HZ), np.full((*SIZE, 3), LEVEL, np.float32)
        depth_m = np.full(SIZE, wall_m, np.float32)
        behind = linear(np.float32(LEVEL))
        light = behind * self.step.parameters(5).brightness
        if self.execution == "lit nodes":
            frame = {"x": (index, IDENTIFIERS)}
            made = self.compositor.evaluate(linear(image), frame, depth_m, {"x": motion})[0]["x"].mean(axis=-1)
            return (made - light * LAWS.shine) / (behind - light * LAWS.shine)
        if self.execution == "nodes":
            made = self.compositor.evaluate(image, {"x": (index, IDENTIFIERS)}, depth_m, {"x": motion})[0]["x"]
        else:
            context = FrameContext(index, IDENTIFIERS, motion=motion, read_depth_m=lambda: depth_m)
            made = self.step.perturbation.apply(image, self.step.parameters(5), self.step.context(context))
        return (linear(made).mean(axis=-1) - light) / (behind - light)


@pytest.fixture(scope="module")
def air():
    """Give what is seen by each execution of snow."""
    step = step_of("snow_depth", severity=5, temporal="drift", size=2.0, frame_rate_hz=RATE_HZ, **STILL_AIR)
    by_light = step_of(
        "snow_depth", severity=5, temporal="drift", size=2.0, frame_rate_hz=RATE_HZ, lamps=0, **STILL_AIR
    )
    size = (SIZE[1], SIZE[0])
    with (
        Compositor(size, {"x": [step]}, SIZE[1]) as compositor,
        Compositor(size, {"x": [by_light]}, SIZE[1], lit=True) as lit,
    ):
        yield {
            "nodes": Seen("nodes", compositor, step),
            "arrays": Seen("arrays", compositor, step),
            "lit nodes": Seen("lit nodes", lit, by_light),
        }


def places(seen, pose_args, near_m, far_m):
    """(N, 2): columns and rows of the particles between two depths, which a wall at either shows and hides."""
    near, far = (seen(*pose_args, wall_m) for wall_m in (near_m, far_m))
    hidden = np.clip(1 - far / near - (1 - far / near).mean() - 2e-4, 0, None)
    count, labels, stats, _ = cv2.connectedComponentsWithStats((hidden > 0.02).astype(np.uint8), connectivity=8)
    found = []
    for number in range(1, count):
        left, top, width, height, area = stats[number]
        inside = left > 3 and top > 3 and left + width < SIZE[1] - 3 and top + height < SIZE[0] - 3
        if inside and area < 150:
            weight = np.where(labels == number, hidden, 0)[top : top + height, left : left + width]
            rows, columns = np.mgrid[top : top + height, left : left + width]
            found.append(((columns * weight).sum() / weight.sum(), (rows * weight).sum() / weight.sum()))
    return np.array(found).reshape(-1, 2)


def flow_errors(seen, pose_of, spans_m, apart_m):
    """Angle in degrees, and ratio of lengths, of each particle's displacement and the one that its distance asks for.

    pose_of: index -> camera to world. spans_m: depths. apart_m: from a pose to the next, how far along z.
    """
    angles, ratios = [], []
    first = pose_of(0)
    turn = pose_of(11)[:3, :3].T @ pose_of(10)[:3, :3]
    for near_m, far_m in spans_m:
        args = [(k, first, pose_of(k - 1), pose_of(k)) for k in (10, 11)]
        before = places(seen, args[0], near_m, far_m)
        after = places(seen, args[1], near_m - apart_m, far_m - apart_m)
        if not len(before) or not len(after):
            continue
        middle_m = (near_m + far_m) / 2
        point = np.column_stack([(before - MIDDLE_PX) / FOCAL_PX, np.ones(len(before))]) * middle_m
        moved = pose_of(11)[:3, :3].T @ (pose_of(10)[:3, 3] - pose_of(11)[:3, 3])
        there = point @ turn.T + moved
        wanted = there[:, :2] / there[:, 2:] * FOCAL_PX + MIDDLE_PX - before
        for place, shift in zip(before, wanted, strict=True):
            if np.hypot(*shift) < 3:  # too short for an angle
                continue
            to = after[np.hypot(*(after - place - shift).T).argmin()] - place
            if np.hypot(*(to - shift)) < 0.5 * np.hypot(*shift) + 1:
                cosine = to @ shift / np.hypot(*to) / np.hypot(*shift)
                angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
                ratios.append(np.hypot(*to) / np.hypot(*shift))
    return np.array(angles), np.array(ratios)


SPANS_M = [(low, low + 0.15) for low in (0.9, 1.2, 1.5, 1.9, 2.3, 2.8)]


def level(index, *, forward_m=0.0, axis="y", degrees=0.0):
    """A camera that looks along y in a world whose z is up, after some steps forward and turns about its own axis."""
    pose = np.eye(4)
    turned = Rotation.from_euler(axis, degrees * index, degrees=True).as_matrix()
    pose[:3, :3] = Rotation.from_euler("x", -90, degrees=True).as_matrix() @ turned
    pose[1, 3] = forward_m * index
    return pose


@cases("execution", ["nodes", "arrays", "lit nodes"])
def test_a_camera_that_drives_flies_through_the_particles(air, execution):
    """At 3 m/s through still air: they flow out of the middle as their distances say."""
    angles, ratios = flow_errors(air[execution], partial(level, forward_m=3.0 / RATE_HZ), SPANS_M, 3.0 / RATE_HZ)
    assert len(angles) > 20
    assert np.median(angles) < 2
    assert np.median(ratios) == pytest.approx(1, abs=0.1)


@cases("execution", ["nodes", "lit nodes"])
@cases("axis", ["x", "y", "z"])
def test_a_camera_that_turns_leaves_them_where_they_are(air, axis, execution):
    seen = air[execution]
    angles, ratios = flow_errors(seen, partial(level, axis=axis, degrees=2.5), SPANS_M[:1], 0.0)
    assert len(angles) > 10
    assert np.median(angles) < 2
    assert np.median(ratios) == pytest.approx(1, abs=0.1)


@cases("lit", [False, True])
@cases("degrees", [0.0, 45.0, 90.0])
def test_no_part_of_an_image_repeats_another(degrees, lit):
    """Whichever of the world's axes the camera looks along, or between which: the image's correlation with itself."""
    height, width = 360, 640
    step = step_of("snow_depth", severity=5, temporal="drift")
    pose = level(1, degrees=degrees)
    motion, depth_m = motion_between(pose, pose, pose, 1.0), np.full((height, width), 12.0, np.float32)
    motion = replace(motion, first_c2w=level(0))
    with Compositor((width, height), {"x": [step]}, width, lit=lit) as compositor:
        image = np.full((height, width, 3), LEVEL, np.float32)
        made = compositor.evaluate(image, {"x": (3, IDENTIFIERS)}, depth_m, {"x": motion})[0]["x"].mean(axis=-1)
    image = np.minimum(made - made.mean(), 8 * made.std())  # so that the few nearest flakes do not decide
    padded, shown = np.zeros((2, 2 * height, 2 * width))
    padded[:height, :width], shown[:height, :width] = image, 1
    sums, common = (np.fft.irfft2(np.abs(np.fft.rfft2(part)) ** 2, part.shape) for part in (padded, shown))
    found = sums / np.maximum(common, 1) / (image**2).mean()
    # Further than flakes are wide, where enough of the image remains to be compared.
    rows, columns = (np.minimum(np.arange(n), n - np.arange(n)) for n in found.shape)
    counts = (common > 0.4 * image.size) & (np.hypot(rows[:, None], columns) > 15)
    assert np.abs(found[counts]).max() < 0.05
