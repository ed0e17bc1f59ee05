# SPDX-License-Identifier: GPL-3.0-or-later
"""What the shutter does, known by plain arithmetic: discs that are smeared on their way, points that rows see late."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtr

from noisy_world.measure.blur import NAMES, blur_figures, evenly_between
from noisy_world.measure.motion import Followed, Steps, moved_by
from noisy_world.measure.readout import readout

# --- discs on a plane, 96 px apart, that the camera sees pass ---

HIGH, WIDE, APART_PX, RADIUS_PX = 192, 192, 96, 32
FRAMES = 18
RATE_HZ = 25.0


def passed_px(frame):
    """How far the plane has moved at a time in frames, (x, y): by 1 to 11 px a frame, in all directions."""
    return np.array([26 * np.sin(0.42 * frame), 17 * np.sin(0.31 * frame + 1)])


def light(frame, sigma_px):
    """(H, W) linear light of discs with Gaussian edges at a time in frames."""
    y, x = np.mgrid[:HIGH, :WIDE]
    across, down = ((axis - by) % APART_PX - APART_PX / 2 for axis, by in zip((x, y), passed_px(frame), strict=True))
    return 0.1 + 0.6 * ndtr((RADIUS_PX - np.hypot(across, down)) / sigma_px)


def figures(exposure, sigma_px, frames=FRAMES, still=False):
    """Figures of frames whose shutter is open for a share of the interval, around each frame's time."""

    def shown(frame):
        times = [0.0 if still else frame + exposure * part for part in (np.arange(11) - 5) / 11]
        mean = np.mean([light(time, sigma_px) for time in times], axis=0)
        encoded = 1.055 * mean ** (1 / 2.4) - 0.055  # IEC 61966-2-1
        return np.repeat(np.rint(255 * encoded).astype(np.uint8)[..., None], 3, axis=2)

    images = [shown(frame) for frame in range(frames)]
    footage = SimpleNamespace(colour=lambda frame: images[frame], rate_hz=RATE_HZ)
    return {figure.name: figure for figure in blur_figures(footage, range(1, frames - 1))}


@pytest.mark.parametrize(("exposure", "sigma_px"), [(0.0, 1.0), (0.45, 1.0), (0.9, 1.8)])
def test_exposure_and_defocus_come_back(exposure, sigma_px):
    found = figures(exposure, sigma_px)
    share = found["exposure_share"]
    assert share.low <= exposure <= share.high
    assert share.value == pytest.approx(exposure, abs=0.05)
    assert found["exposure_ms"].value == pytest.approx(1e3 / RATE_HZ * share.value)
    ways_px = [np.linalg.norm(passed_px(frame + 0.5) - passed_px(frame - 0.5)) for frame in range(1, FRAMES - 1)]
    assert found["motion_blur_px"].value == pytest.approx(share.value * np.median(ways_px), rel=0.1)
    assert found["defocus_sigma_px"].low < sigma_px < found["defocus_sigma_px"].high


def test_wide_blur_is_seen_in_smaller_images_and_a_still_camera_tells_no_exposure():
    wide = figures(0.0, 4.0, still=True)
    assert wide["defocus_sigma_px"].value == pytest.approx(4.0, rel=0.15)
    assert all("moves too little" in wide[name].untold for name in NAMES[:4])


def test_an_image_without_edges_tells_nothing():
    flat = SimpleNamespace(colour=lambda frame: np.full((HIGH, WIDE, 3), 128, np.uint8), rate_hz=RATE_HZ)
    assert all("too few edges" in figure.untold for figure in blur_figures(flat, range(1, 9)))


def test_frames_beside_lost_ones_tell_no_way():
    stamps_s = np.array([0, 1, 2, 3, 5, 6, 7, 8]) / RATE_HZ
    assert evenly_between([0, 2, 3, 4, 6, 7], stamps_s) == [1, 2, 6]
    still = SimpleNamespace(colour=lambda frame: np.zeros((HIGH, WIDE, 3), np.uint8), rate_hz=RATE_HZ)
    assert all("too few frames" in figure.untold for figure in blur_figures(still, [1, 2]))


# --- points that are seen by lines, one after another ---


def turned_and_moved(frame):
    """(N,) times in frames -> rotation vectors and translations (N, 3) of the world before the camera."""
    t = np.asarray(frame)[:, None]
    turn = np.array([0.05, 0.08, 0.03]) * np.sin(t * [0.35, 0.27, 0.4] + [0, 1, 2])
    return turn, np.array([0.1, 0.05, 0.08]) * np.sin(t * [0.2, 0.33, 0.25] + [1, 0, 2])


def seen(points, frame, share, rights):
    """Where points (N, 3) are on the plane at 1, each at the time at which its line is read; lines from -1/2 to 1/2."""
    late = np.zeros(len(points))
    for _ in range(12):
        turn, move = turned_and_moved(frame + late)
        angle = np.linalg.norm(turn, axis=1, keepdims=True)
        axis = turn / np.maximum(angle, 1e-12)
        along = (points * axis).sum(axis=1, keepdims=True) * axis  # Rodrigues' formula
        whole = along + (points - along) * np.cos(angle) + np.cross(axis, points) * np.sin(angle) + move
        plane = whole[:, :2] / whole[:, 2:]
        late = share * plane[:, 0 if rights else 1] / 1.2  # the image is 1.2 wide and high there
    return plane, whole[:, 2]


def steps(share, rights=False, count=40, still=False):
    """Steps of frames whose lines see the scene one after another, a share of the interval in all."""
    rng = np.random.default_rng(4)
    points = np.concatenate([rng.uniform(-1, 1, (90, 2)), rng.uniform(1.5, 4, (90, 1))], axis=1)
    points[:, :2] *= points[:, 2:] / 2
    views = [seen(points, 0.0 if still else frame, share, rights) for frame in range(count + 1)]
    followed, moves = [], []
    for (one, depth), (other, _) in pairwise(views):
        inside = (np.abs(one) < 0.6).all(axis=1) & (np.abs(other) < 0.6).all(axis=1)
        here, there, inverse = one[inside], other[inside], 1 / depth[inside]
        moves.append(moved_by(here, there, inverse, 300.0))
        followed.append(Followed(here, there, inverse, np.stack([here, there]) / 1.2, 300.0))
    frames = np.stack([np.arange(count), np.arange(count) + 1], axis=1)
    none, no = np.zeros(count), np.zeros(count, np.bool_)
    zero = np.zeros((count, 6, 6)), np.zeros((count, 6))
    return Steps(frames, np.zeros(count, int), np.array(moves), *zero, no, no, none, {}, tuple(followed))


@pytest.mark.parametrize(("share", "rights"), [(0.0, False), (0.8, False), (-0.5, True)])
def test_readout_comes_back_with_its_direction(share, rights):
    down, right = readout(steps(share, rights), RATE_HZ)
    read, other = (right, down) if rights else (down, right)
    assert read.value == pytest.approx(share * 1e3 / RATE_HZ, rel=0.05, abs=0.4)
    assert read.low < share * 1e3 / RATE_HZ < read.high
    if share:
        assert "the other direction" in other.untold
    else:
        assert other.low < 0 < other.high


@pytest.mark.parametrize(
    ("given", "rate_hz", "why"),
    [
        (steps(0.5, still=True), RATE_HZ, "changes too little"),
        (steps(0.5, count=8), RATE_HZ, "too few frames"),
        (steps(0.5, count=8), None, "one frame alone"),
    ],
    ids=["still", "short", "one"],
)
def test_what_does_not_tell_a_readout_says_why(given, rate_hz, why):
    assert all(figure.value is None and why in figure.untold for figure in readout(given, rate_hz))
