# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise that is put on clean frames comes back from the frames alone: known in, known out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.schema import ConfigPath
from noisy_world.measure.colour_noise import colour_noise
from noisy_world.measure.depth_blocks import Registered
from noisy_world.measure.depth_holes import HoleFrame, depth_holes
from noisy_world.measure.depth_noise import depth_noise
from noisy_world.measure.footage import Look, footage_of
from noisy_world.measure.imu_noise import imu_noise
from noisy_world.measure.motion import Followed, Steps
from noisy_world.perturbations.shipped._depth_devices import cosine_of_incidence
from noisy_world.sources.recording import read_recording

COUNT = 16
HIGH, WIDE = 144, 192
RNG = np.random.default_rng(5)


CAMERA = Intrinsics(WIDE, HIGH, 150.0, 150.0, (WIDE - 1) / 2, (HIGH - 1) / 2)


class Looks(list):
    """Looks at frames, as footage gives them."""

    camera = CAMERA

    def look(self, frame):
        return self[frame]


@pytest.fixture(scope="module")
def clean(walk):
    """Some looks at the clean walk."""
    source = read_recording(walk / "clean/room", ConfigPath("test"))
    with footage_of("walk", source, source.camera(None)) as footage:
        return Looks(footage.look(frame) for frame in range(0, 6 * COUNT, 6))


def with_colour(looks, noise):
    """The looks with noise, a function of full scale to full scale, on their colour."""
    made = [np.clip(np.rint(255 * noise(look.colour / 255.0)), 0, 255).astype(np.uint8) for look in looks]
    return Looks(replace(look, colour=colour) for look, colour in zip(looks, made, strict=True))


def plain(clean):
    """The looks as a lens out of focus shows them: without the texture of single pixels, which hides noise."""
    return Looks(replace(look, colour=gaussian_filter(look.colour, (2, 2, 0))) for look in clean)


@pytest.mark.parametrize("std", [0.02, 0.06])
def test_gaussian_noise_of_colour(clean, std):
    found = colour_noise(with_colour(plain(clean), lambda x: x + RNG.normal(0, std, x.shape)), range(COUNT))
    assert found.gaussian_std.value == pytest.approx(std, rel=0.1)
    hidden = colour_noise(with_colour(clean, lambda x: x + RNG.normal(0, std, x.shape)), range(COUNT)).gaussian_std
    assert hidden.low < std < hidden.high
    assert abs(found.correlation.value) < 0.15
    assert found.remark == ""


@pytest.mark.parametrize("photons", [25, 100])
def test_shot_noise_of_colour(clean, photons):
    found = colour_noise(with_colour(plain(clean), lambda x: RNG.poisson(x * photons) / photons), range(COUNT))
    slope = found.per_photon
    assert slope.value == pytest.approx(1 / photons, rel=0.1)
    assert slope.low < 1 / photons < slope.high


def test_noise_that_was_smoothed_is_said_to_be(clean):
    smoothed = with_colour(clean, lambda x: gaussian_filter(x + RNG.normal(0, 0.08, x.shape), (1, 1, 0)))
    found = colour_noise(smoothed, range(COUNT))
    assert "denoised" in found.remark
    assert found.correlation.value > 0.4
    assert "denoised" in colour_noise(clean, range(COUNT)).remark
    assert colour_noise(clean, range(COUNT)).gaussian_std.value is None


def walls(noise, count=COUNT, slant=None):
    """Looks at a wall that is seen at a slant, at 1 to 4 m, with noise in metres: a function of depth.

    slant: of each frame, its inverse depth over the image, where it is another one.
    """
    grey, colour = np.full((HIGH, WIDE), 128, np.uint8), np.full((HIGH, WIDE, 3), 128, np.uint8)
    v, u = np.mgrid[:HIGH, :WIDE]
    made = Looks()
    for frame in range(count):
        steep = 0.74 if slant is None else slant[frame]
        depth_m = 1 / (1 - steep * (0.9 * u / WIDE + 0.1 * v / HIGH))
        made.append(Look(grey, (depth_m + noise(depth_m)).astype(np.float32), grey, colour))
    return made


def test_depth_noise_by_distance():
    found = depth_noise(walls(lambda z: RNG.normal(0, 1, z.shape) * (0.001 + 0.0015 * z**2)), range(COUNT))
    assert len(found.curve) >= 7
    for z, figure in found.curve:
        assert figure.value == pytest.approx(0.001 + 0.0015 * z**2, rel=0.1)
    offset, quadratic = found.law
    assert quadratic.value == pytest.approx(0.0015, rel=0.1)
    assert offset.value == pytest.approx(0.001, rel=0.25)
    assert all(abs(figure.value) < 0.03 for figure in found.correlation[:3])
    assert found.correlation[3].value == pytest.approx(0.25, abs=0.03)


def test_correlation_of_depth_noise():
    sigma_px = 1.2  # of the filter: neighbours at d are correlated by exp(-d^2 / 4 sigma^2)

    def smooth(z):
        white = gaussian_filter(RNG.normal(0, 1, z.shape), sigma_px)
        return white / white.std() * 0.002 * z**2

    found = depth_noise(walls(smooth), range(COUNT))
    for lag, figure in zip((1, 2, 4), found.correlation[:3], strict=True):
        assert figure.value == pytest.approx(np.exp(-(lag**2) / (4 * sigma_px**2)), abs=0.05)
    assert abs(found.correlation[4].value) < 0.05  # each frame draws its own


class Walk(Looks):
    """Looks along a wall with relief, by a camera that is at places `at_m` along it, and by colour at `by_colour_m`."""

    size_px = WIDE, HIGH
    lens = SimpleNamespace(distortion=None)

    def __init__(self, at_m, noise, high_m=0.006, by_colour_m=None):
        rays = self.plane(np.mgrid[:HIGH, :WIDE].reshape(2, -1).T[:, ::-1]).reshape(HIGH, WIDE, 2)
        grey, colour = np.zeros((HIGH, WIDE), np.uint8), np.zeros((HIGH, WIDE, 3), np.uint8)
        for place_m in at_m:
            depth_m = np.full((HIGH, WIDE), 2.0)
            for _ in range(5):
                x, y = rays[..., 0] * depth_m + place_m, rays[..., 1] * depth_m
                # Waves of 20 cm on a wall that goes back at one side.
                relief_m = high_m * (np.sin(31 * x + 7 * y) + np.cos(27 * y - 10 * x))
                depth_m = (2.0 + 0.4 * place_m + relief_m) / (1 - 0.4 * rays[..., 0])
            self.append(Look(grey, (depth_m + noise(depth_m)).astype(np.float32), grey, colour))
        count = len(at_m) - 1
        moves = np.zeros((count, 6))
        moves[:, 3] = -np.diff(at_m if by_colour_m is None else by_colour_m)
        here, inverse = RNG.uniform(-0.5, 0.5, (60, 2)), RNG.uniform(0.3, 0.7, 60)
        there = [here + [move, 0] * inverse[:, None] + RNG.normal(0, 1e-4, (60, 2)) for move in moves[:, 3]]
        none = np.zeros(count, np.bool_)
        self.steps = Steps(
            np.stack([np.arange(count), np.arange(1, count + 1)], axis=1),
            np.zeros(count, np.int64),
            moves,
            np.zeros((count, 6, 6)),
            np.zeros((count, 6)),
            none,
            none,
            np.zeros(count),
            {},
            tuple(Followed(here, each, inverse, np.zeros((2, 60, 2)), CAMERA.fx_px) for each in there),
        )

    def depth(self, frame):
        return self[frame].depth_m

    @staticmethod
    def plane(points):
        return (np.asarray(points, np.float64) - (CAMERA.cx_px, CAMERA.cy_px)) / CAMERA.fx_px


def test_relief_of_surfaces_is_no_noise():
    rng = np.random.default_rng(1)

    def patches(z):
        white = gaussian_filter(rng.normal(0, 1, z.shape), 1.5)
        return 0.001 * z**2 * (white / white.std() + rng.normal(0, 1, z.shape))

    at_m = 0.03 * np.arange(COUNT + 6)
    walk = Walk(at_m, patches, by_colour_m=1.05 * at_m)
    found = depth_noise(walk, range(COUNT), Registered(walk, walk.steps, 0.0))
    plain, flat = (depth_noise(each, range(COUNT)) for each in (walk, Walk(at_m, patches, high_m=0.0)))
    for (z, figure), (_, whole), (at, known) in zip(found.curve, plain.curve, flat.curve, strict=True):
        assert figure.value == pytest.approx(known.value * (z / at) ** 2, rel=0.12)
        assert whole.value > figure.value
    assert (
        max(whole.value / figure.value for (_, figure), (_, whole) in zip(found.curve, plain.curve, strict=True)) > 1.1
    )
    for lag, figure in zip((1, 2, 4), found.correlation[:3], strict=True):
        assert figure.value == pytest.approx(0.5 * np.exp(-(lag**2) / 9), abs=0.05)
    assert abs(found.correlation[4].value) < 0.05
    still = Walk(0 * at_m, patches)
    bound = depth_noise(still, range(COUNT), Registered(still, still.steps, 0.0))
    for (z, figure), (at, known) in zip(bound.curve, flat.curve, strict=True):
        assert figure.low < known.value * (z / at) ** 2 < 1.1 * figure.high
    assert "hardly moves" in bound.correlation[0].untold


def test_steps_of_depth():
    step_per_m = 0.003
    noisy = walls(lambda z: RNG.normal(0, 0.002, z.shape) * z**2)
    disparity = Looks(
        replace(look, depth_m=(1 / (np.rint(1 / look.depth_m / step_per_m) * step_per_m)).astype(np.float32))
        for look in noisy
    )
    _, per_m = depth_noise(disparity, range(COUNT)).steps
    assert per_m.value == pytest.approx(step_per_m, rel=0.05)
    even = Looks(replace(look, depth_m=(np.rint(look.depth_m / 0.004) * 0.004).astype(np.float32)) for look in noisy)
    smallest, per_m = depth_noise(even, range(COUNT)).steps
    assert smallest.value == pytest.approx(0.004, rel=0.01)
    assert per_m.value is None


def test_what_places_beside_its_own_add_to_a_pixels_noise():
    slant = np.linspace(0.2, 0.74, COUNT)
    shift_px = 0.8

    def moved(z):
        right, down = RNG.normal(0, shift_px, (2, *z.shape))
        per_m = 1 / z
        across, along = np.gradient(per_m)[::-1]
        return 1 / (per_m + across * right + along * down) - z + RNG.normal(0, 0.001, z.shape) * z**2

    found = {figure.name: figure for figure in depth_noise(walls(moved, slant=slant), range(COUNT)).sideways}
    shift = found["depth_shift_px"]
    assert shift.value == pytest.approx(shift_px, rel=0.1)
    assert shift.low < shift_px < shift.high
    assert found["depth_noise_head_on_quadratic_per_m"].value == pytest.approx(0.001, rel=0.15)
    still = depth_noise(walls(lambda z: RNG.normal(0, 0.001, z.shape) * z**2, slant=slant), range(COUNT)).sideways
    assert still[0].value < 0.2
    assert all(figure.value == pytest.approx(1, abs=0.1) for figure in still[3:])


def boxes(seen):
    """Depth of a post at 1 m before a wall at 2 m, as `seen` changes rows of it, and its grey."""
    rows_m = np.full((HIGH, WIDE), 2.0, np.float32)
    for number in range(4):
        rows_m[:, 30 + 45 * number : 45 + 45 * number] = 1.0 + 0.1 * number
    return [HoleFrame(seen(rows_m.copy()), np.full((HIGH, WIDE), 128, np.uint8), None)] * 8


def test_shadows_and_pixels_in_the_air():
    baseline_m = 0.08

    def shadowed(rows_m):
        for left in range(30, WIDE, 45):
            wide = round(CAMERA.fx_px * baseline_m * (1 / rows_m[0, left] - 0.5))
            rows_m[:, left - wide : left] = 0
        return rows_m

    def flying(rows_m):
        rows_m[: HIGH // 4 * 2, 45] = 1.5
        return rows_m

    found = {figure.name: figure for figure in depth_holes(boxes(shadowed), CAMERA)}
    baseline = found["shadow_baseline_m"]
    assert baseline.low < baseline_m < baseline.high
    assert baseline.value == pytest.approx(baseline_m, rel=0.1)
    mirrored = depth_holes(boxes(lambda rows_m: shadowed(rows_m)[:, ::-1].copy()), CAMERA)
    assert {figure.name: figure.value for figure in mirrored}["shadow_baseline_m"] < 0
    found = {figure.name: figure for figure in depth_holes(boxes(flying), CAMERA)}
    assert found["shadow_baseline_m"].value == 0
    assert found["flying_pixels_share"].value == pytest.approx(1 / 16)  # half of the rows of one of 8 edges


def test_holes_where_little_light_comes_back():
    least, spread, px, frames = 0.1, 1.0, 5.0, 3
    slopes = walls(lambda z: 0 * z, slant=[0.6] * COUNT)
    whole_m = slopes[0].depth_m
    light = cosine_of_incidence(whole_m, CAMERA) / whole_m**2
    drawn = [gaussian_filter(RNG.normal(0, 1, whole_m.shape), px / 2) for _ in range(COUNT + frames)]
    drawn = np.array(drawn) / np.std(drawn)
    for frame, look in enumerate(slopes):
        field = drawn[frame : frame + frames].sum(axis=0) / np.sqrt(frames)
        look.depth_m[light * np.exp(spread * field) < least] = 0
        look.depth_m[:, -3:] = 0
    found = {figure.name: figure for figure in depth_noise(slopes, range(COUNT)).holes}
    assert found["border_right_px"].value == 3
    assert found["border_left_px"].value == 0
    # Holes on a steep surface are taken for such beside edges, the more the larger they are.
    for name, known in (("least_light", least), ("light_spread", spread), ("clump_px", px), ("clump_frames", frames)):
        assert found[f"hole_{name}"].value == pytest.approx(known, rel=0.3)
    none = {figure.name: figure for figure in depth_noise(walls(lambda z: 0 * z), range(COUNT)).holes}
    assert "too few holes" in none["hole_least_light"].untold


def test_holes_by_what_they_are_beside():
    looks = walls(lambda z: 0 * z)
    for look in looks:
        look.depth_m[:, :8] = 0  # the border
        look.depth_m[20:30, 60:70] = 0
    dark = Looks(replace(look, grey=np.where(look.depth_m > 0, look.grey, 10).astype(np.uint8)) for look in looks)
    shares = [figure.value for figure in depth_noise(looks, range(COUNT)).holes[:4]]
    frame = HIGH * WIDE
    # What is void in each frame at the same place is taken for the border.
    assert sum(shares) == pytest.approx((8 * HIGH + 100) / frame)
    assert shares[0] == pytest.approx((8 * HIGH + 100) / frame)
    moved = Looks(dark)
    for number, look in enumerate(moved):
        moved[number] = replace(
            look, depth_m=np.roll(look.depth_m, 3 * number, axis=0), grey=np.roll(look.grey, 3 * number, axis=0)
        )
    shares = [figure.value for figure in depth_noise(moved, range(COUNT)).holes[:4]]
    assert shares[0] == pytest.approx(8 * HIGH / frame)
    assert sum(shares[1:]) == pytest.approx(100 / frame)


def test_white_noise_of_an_imu(walk):
    # The walk's IMU is a bmi055: 1.28e-4 rad/s/sqrt(Hz) and 8.4e-4 m/s^2/sqrt(Hz), by VINS-Mono's thread 472.
    imu = read_recording(walk / "clean/room", ConfigPath("test")).capabilities.imu
    gyro, accel = imu_noise(imu)[:2]
    assert gyro.value == pytest.approx(1.28e-4, rel=0.1)
    assert accel.value == pytest.approx(8.4e-4, rel=0.1)
    few = SimpleNamespace(samples=replace(imu.samples, stamps_ns=imu.samples.stamps_ns[:50]))
    assert imu_noise(few)[0].value is None
    assert "too few" in imu_noise(few)[0].untold


def test_colour_that_was_compressed_in_chroma_is_said_to_be(clean):
    """Averages of four pixels leave chroma a quarter of its variance: red and green share what luminance has."""
    rng = np.random.default_rng(9)

    def subsampled(image):
        noisy = image + rng.normal(0, 0.05, image.shape)
        luminance = (noisy @ [0.299, 0.587, 0.114])[..., None]
        chroma = noisy - luminance
        means = chroma.reshape(high // 2, 2, wide // 2, 2, 3).mean(axis=(1, 3))
        return luminance + means.repeat(2, axis=0).repeat(2, axis=1)

    high, wide = clean[0].colour.shape[:2]
    found = colour_noise(with_colour(plain(clean), subsampled), range(COUNT))
    assert found.between_channels.value > 0.4
    assert "red and green" in found.remark
    each = colour_noise(with_colour(plain(clean), lambda x: x + rng.normal(0, 0.05, x.shape)), range(COUNT))
    assert abs(each.between_channels.value) < 0.15
    grey = Looks(replace(look, colour=look.colour[..., :1].repeat(3, axis=2)) for look in clean)
    same = with_colour(plain(grey), lambda x: x + rng.normal(0, 0.05, (*x.shape[:2], 1)))
    assert "grey" in colour_noise(same, range(COUNT)).between_channels.untold
