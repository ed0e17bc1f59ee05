# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth sensors against the published figures, closed forms and plain loops."""

import itertools
import math

import numpy as np
import pytest
from refusals import refused
from cases import cases

from noisy_world.core.geometry import Intrinsics
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturb import apply
from noisy_world.perturbations import registry
from noisy_world.perturbations.shipped._depth_devices import shadowed
from noisy_world.perturbations.shipped._depth_devices import cosine_of_incidence
from noisy_world.perturbations.shipped._noise import SharedNoise, drawn
from noisy_world.perturbations.steps import deciding

pytestmark = pytest.mark.filterwarnings("error")

SENSORS = ("axial_noise", "lidar", "redwood", "stereo", "structured_light", "time_of_flight")
GREY = 0.735357  # sRGB's code of half the light, a surface of albedo 0.5
LIGHT = 299_792_458.0


def camera_of(shape, focal_px=500.0):
    return Intrinsics(shape[1], shape[0], focal_px, focal_px, (shape[1] - 1) / 2, (shape[0] - 1) / 2)


def measured(name, depth_m, focal_px=500.0, frame=0, rgb=None, **values):
    depth_m = np.asarray(depth_m, np.float32)
    rgb = np.full((*depth_m.shape, 3), GREY, np.float32) if rgb is None else rgb
    return apply(
        depth_m, name, seed=3, frame=frame, rgb=rgb, intrinsics=camera_of(depth_m.shape, focal_px), **values
    ).astype(np.float64)


def deviation_mm(name, z_m, **values):
    """Of a plane seen nearly head on, through a long lens; where something is given at all."""
    found = measured(name, np.full((200, 300), z_m), 5000.0, **values)
    return 1e3 * found[found > 0].std()


# --- the table of figures, from the sources that docs/sensors.md names ---


@cases(
    ("name", "values", "expected_mm"),
    [
        ("stereo", {"least_contrast": 0}, (3.8, 15, 34)),
        ("structured_light", {}, (None, 1.5, 11)),  # 0.53 at 1 m, where the table says .5: see the next test
        ("redwood", {}, (0.6, 7.1, 13)),
        ("time_of_flight", {}, (1, 2, 3)),
        ("axial_noise", {"device": "nguyen_2012"}, (1.9, 6.1, 14)),
        ("axial_noise", {"device": "khoshelham_2012"}, (1.4, 5.7, 12.8)),
        ("axial_noise", {"device": "azure_kinect"}, (1, 2, 3)),
        ("axial_noise", {"device": "kinect_v1_law"}, (1.58, 5.72, 12.6)),
    ],
)
def test_planes_spread_as_the_published_laws_say(name, values, expected_mm):
    for z_m, expected in zip((1, 2, 3), expected_mm, strict=True):
        if expected is not None:
            assert deviation_mm(name, z_m, **values) == pytest.approx(expected, rel=0.05), z_m


@cases("incidence_deg", [55.0, 70.0, 78.0, 88.0, 89.9])
def test_nguyens_law_grows_from_sixty_to_eighty_degrees_of_incidence(incidence_deg):
    """sigma = .0012 + .0019 (z - .4)^2 + .0001 / sqrt(z) (a / (90 - a))^2, a from 60 to 80; through a long lens."""
    across = (np.arange(21) - 10) / 50_000.0
    z_m = 2.0 / (1 + across * math.tan(math.radians(incidence_deg))) * np.ones((21, 1))
    off_m = [
        measured("axial_noise", z_m, 50_000.0, frame, lateral_px=0, lateral_steep_px=0) - z_m for frame in range(100)
    ]
    angle = min(incidence_deg, 80.0)
    steep = 0.0001 / math.sqrt(2) * (angle / (90 - angle)) ** 2 if angle > 60 else 0.0
    assert np.std(np.array(off_m)[:, :, 8:13]) == pytest.approx(0.0012 + 0.0019 * 1.6**2 + steep, rel=0.03)


def rounded_deviation_mm(z_m, product_m, sigma_steps, half):
    """The deviation of product / (round(product / z + N(0, sigma) + half) - half), summed over all steps."""
    middle = product_m / z_m
    steps = np.arange(math.floor(middle) - 12, math.ceil(middle) + 13) - half
    ends = (np.concatenate([steps - 0.5, steps[-1:] + 0.5]) - middle) / sigma_steps / math.sqrt(2)
    chance = np.diff([0.5 * (1 + math.erf(end)) for end in ends])
    mean = np.sum(chance * product_m / steps)
    return 1e3 * math.sqrt(np.sum(chance * (product_m / steps - mean) ** 2))


@cases(
    ("name", "product_m", "sigma_steps", "half"),
    [("structured_light", 351.3, 1 / 6, 0.5), ("redwood", 281.04, 0.222224, 0.0)],
)
@cases("z_m", [1.0, 2.0, 3.0, 3.7])
def test_rounded_disparity_spreads_as_summed_over_its_steps(name, product_m, sigma_steps, half, z_m):
    assert deviation_mm(name, z_m) == pytest.approx(rounded_deviation_mm(z_m, product_m, sigma_steps, half), rel=0.03)


def test_disparity_is_rounded_in_the_devices_own_pixels():
    depth = np.full((40, 300), 2.03)
    found = measured("stereo", depth, 777.0, least_contrast=0, noise=0)
    steps = 424 * 0.05 / found[found > 0] * 32
    np.testing.assert_allclose(steps, round(424 * 0.05 / 2.03 * 32), rtol=1e-6)
    found = measured("stereo", depth, 777.0, least_contrast=0, noise=0, baseline_m=0.1, step_px=0.5)
    np.testing.assert_allclose(424 * 0.1 / found[found > 0] * 2, round(424 * 0.1 / 2.03 * 2), rtol=1e-6)


# --- the shadow of a baseline ---


@cases(("near_m", "far_m", "edge"), [(1.0, 3.0, 120), (0.9, 1.3, 131), (1.7, 5.1, 140), (0.8, 0.83, 110)])
def test_a_shadow_is_f_b_times_the_difference_of_inverse_depths_wide(near_m, far_m, edge):
    depth = np.full((20, 240), far_m)
    depth[:, edge:] = near_m
    for name, product, values in (
        ("stereo", 500 * 0.05, {"least_contrast": 0}),
        ("structured_light", 500 * 0.075, {"window_px": 0, "min_m": 0, "max_m": 100}),
    ):
        found = measured(name, depth, noise=0, **values)
        lost = np.flatnonzero(found[10, 60:] == 0) + 60
        width = product * (1 / near_m - 1 / far_m)
        assert abs(lost.size - width) <= 0.5, name
        np.testing.assert_array_equal(lost, np.arange(edge - lost.size, edge))


def test_what_is_narrower_than_its_shadow_hides_only_its_own_width():
    """Against rays: a point is hidden where the segment to the second eye meets the pole."""
    f, b, near, far, left, right = 500.0, 0.1, 1.0, 4.0, 150, 160
    depth = np.full((9, 300), far, np.float32)
    depth[:, left:right] = near
    hidden = shadowed((f * b / depth).astype(np.float32))[4]
    expected = np.zeros(300, bool)
    for column in range(300):
        if not left <= column < right:
            x = column * far / f  # against the left eye at 0, the right one at b
            share = (far - near) / far  # of the way from the point to the eye where it is as near as the pole
            expected[column] = left - 0.5 <= (x + (b - x) * share) * f / near < right - 0.5
    assert 8 <= expected.sum() <= 12 < f * b * (1 / near - 1 / far)
    assert np.sum(hidden != expected) <= 2  # it ends to within two pixels
    starts, ends = np.flatnonzero(expected)[[0, -1]]
    assert not hidden[: starts - 2].any()
    assert not hidden[ends + 3 :].any()


def test_what_the_right_eye_has_no_place_for_is_lost_at_the_left():
    found = measured("stereo", np.full((6, 200), 1.0), noise=0, least_contrast=0)
    assert ((found > 0) == (np.arange(200) >= 25)).all()


# --- texture, window, range ---


def test_walls_without_texture_are_lost_where_the_pattern_has_faded():
    rgb = np.full((40, 400, 3), 0.5, np.float32)
    rgb[:, 200::2] = 0.6  # texture to the right
    # The pattern's contrast 0.5 * 0.16 / z^2 is 0.01 at 2.83 m.
    for z_m, kept in ((2.7, True), (2.95, False)):
        found = measured("stereo", np.full((40, 400), z_m), rgb=rgb, speckle=0)
        assert (found[:, 30:190] > 0).all() == kept
        assert (found[:, 30:190] > 0).any() == kept
        assert (found[:, 210:] > 0).all()
    share = (measured("stereo", np.full((300, 400), 2.83), 100.0)[:, 20:] == 0).mean()
    # Speckle is gamma, of mean 1 and deviation .25; the pattern is that of GREY here.
    least = 0.01 * 2.83**2 / (0.16 * GREY)
    draws = np.random.default_rng(1).gamma(16, 1 / 16, 400_000)
    assert share == pytest.approx((draws < least).mean(), abs=0.01)


def test_speckle_and_the_error_of_disparity_are_independent():
    """Where half is lost, what is left errs by nothing on average: draws that both took would leave .8 deviations."""
    found = measured("stereo", np.full((300, 400), 3.43), 500.0, step_px=0)[:, 30:]
    off_px = 424 * 0.05 * (1 / found[found > 0] - 1 / 3.43)
    assert 0.2 < (found > 0).mean() < 0.8
    assert abs(off_px.mean()) < 5 * 0.08 / math.sqrt(len(off_px))
    assert off_px.std() == pytest.approx(0.08, rel=0.02)


def test_a_window_that_shows_mostly_another_surface_gives_nothing():
    depth = np.full((80, 80), 2.0)
    depth[20:40, 20:40] = 1.0
    depth[60:63, 10:70] = 1.0  # three of nine rows
    found = measured("structured_light", depth, 585.5, noise=0, baseline_m=1e-3 * 75, least_share=0.4)
    lost = (found == 0) & (depth == 1)
    assert lost[61, 20:60].all()
    assert lost[20, [20, 39]].all()  # 25 of 81
    assert not lost[20:35, 25:35].any()


@cases(
    ("name", "key", "low", "high"),
    [
        ("structured_light", "device", 0.8, 4.0),
        ("time_of_flight", "device", 0.5, 3.86),
        ("redwood", "max_m", 0.0, 10.0),
        ("stereo", "max_m", 424 * 0.05 / 126, 10.0),
    ],
)
def test_outside_its_range_a_sensor_gives_nothing(name, key, low, high):
    for z_m, seen in ((low * 0.98, False), (low * 1.02, low > 0), (high * 0.97, True), (high * 1.02, False)):
        if z_m > 0:
            found = measured(
                name, np.full((6, 300), z_m), 100.0, noise=0, **({"least_contrast": 0} if name == "stereo" else {})
            )
            assert (found[:, -50:] > 0).all() == seen, (key, z_m)


# --- time of flight ---


def tapped_range_m(ranges_m, electrons, frequency_hz, contrast):
    """The range from four samples of the correlation with a sine, each integrated over the surfaces of a pixel."""
    turns = (np.arange(4096) + 0.5) / 4096
    samples = []
    for offset in range(4):
        sample = 0.0
        for range_m, count in zip(ranges_m, electrons, strict=True):
            delay = 2 * range_m / LIGHT * frequency_hz
            light = 1 + contrast * np.cos(2 * np.pi * (turns - delay))
            gate = 1 + np.cos(2 * np.pi * (turns - offset / 4))
            sample += count * np.mean(light * gate)
        samples.append(sample)
    phase = math.atan2(samples[1] - samples[3], samples[0] - samples[2]) % (2 * math.pi)
    return phase * LIGHT / (4 * math.pi * frequency_hz)


@cases(("near_m", "far_m"), [(1.0, 1.2), (1.5, 1.9), (2.0, 2.3)])
def test_a_flying_pixel_is_where_four_samples_of_both_surfaces_put_it(near_m, far_m):
    depth = np.full((7, 9), far_m)
    depth[:, 5:] = near_m
    found = measured("time_of_flight", depth, 1e5, noise=0, spread=0.15, unambiguous_m=0, min_m=0)
    for column, share in ((4, 0.15), (5, 0.85)):
        counts = np.array([share / near_m**2, (1 - share) / far_m**2])
        wrapped = tapped_range_m((near_m, far_m), counts, 200e6, 0.8)
        assert found[3, column] == pytest.approx(wrapped, abs=1e-3)
        with_turns = measured("time_of_flight", depth, 1e5, noise=0, spread=0.15, min_m=0)[3, column]
        fine = LIGHT / 4e8
        assert min(abs((with_turns - wrapped) % fine), fine - (with_turns - wrapped) % fine) < 1e-3
        assert near_m - 0.01 < with_turns < far_m + 0.01


@cases("z_m", [1.0, 2.5])
def test_the_noise_of_a_phase_is_that_of_four_samples_of_electrons(z_m):
    generator = np.random.default_rng(4)
    electrons, phase = 11_200 / z_m**2, 4 * math.pi * 200e6 * z_m / LIGHT
    samples = [
        generator.poisson(electrons * (1 + 0.8 * math.cos(phase - k * math.pi / 2)), 200_000)
        + 6 * generator.standard_normal(200_000)
        for k in range(4)
    ]
    drawn = np.unwrap([phase])[0] + np.angle(
        ((samples[0] - samples[2]) + 1j * (samples[1] - samples[3])) * np.exp(-1j * phase)
    )
    expected_mm = 1e3 * drawn.std() * LIGHT / (4 * math.pi * 200e6)
    assert deviation_mm("time_of_flight", z_m, spread=0) == pytest.approx(expected_mm, rel=0.03)


def test_range_begins_again_beyond_what_frequencies_tell_apart():
    values = {"noise": 0, "least_electrons": 0, "max_m": 100, "min_m": 0}
    fine = LIGHT / 4e8
    found = measured("time_of_flight", np.full((5, 5), 16.5), 1e5, **values)
    assert found == pytest.approx(16.5 - 20 * fine, abs=1e-3)  # the device's 15 m are 20 turns
    values["unambiguous_m"] = 0
    assert measured("time_of_flight", np.full((5, 5), 2.0), 1e5, **values) == pytest.approx(2 % fine, abs=1e-4)


def test_dark_and_oblique_surfaces_and_jumps_give_nothing():
    rgb = np.full((30, 60, 3), GREY, np.float32)
    rgb[:, 30:] = 0.01
    found = measured("time_of_flight", np.full((30, 60), 2.0), 1e4, rgb=rgb, spread=0)
    np.testing.assert_array_equal(found[0] > 0, np.arange(60) < 30)
    depth = np.full((30, 60), 2.0)
    depth[:, 30:] = 2.9
    found = measured("time_of_flight", depth, 1e4)
    np.testing.assert_array_equal(found[0] > 0, np.abs(np.arange(60) - 29.5) > 1)


# --- incidence ---


def plane(normal, distance_m, camera):
    """Planar depth of the plane normal . p = distance_m, and the cosine of incidence on it."""
    rays = camera.ray_directions()
    normal = np.array(normal) / np.linalg.norm(normal)
    depth = distance_m / (rays @ normal)
    return depth.astype(np.float32), np.abs(rays @ normal) / np.linalg.norm(rays, axis=-1)


def test_incidence_on_planes_is_exact_up_to_their_edges():
    camera = camera_of((60, 80), 90.0)
    left, of_left = plane((0.9, 0.31, 0.47), 1.0, camera)
    right, of_right = plane((-0.2, 0.1, 1.0), 8.0, camera)  # they do not meet
    depth, expected = left.copy(), of_left.copy()
    depth[:, 50:], expected[:, 50:] = right[:, 50:], of_right[:, 50:]
    depth[depth < 0] = 0
    known = depth > 0
    known[:, :25] = False  # there the plane is seen edge on
    np.testing.assert_allclose(cosine_of_incidence(depth, camera)[known], expected[known], atol=2e-3)


def test_sideways_an_edge_is_as_ragged_as_the_law_says():
    depth = np.full((4000, 60), 2.0)
    depth[:, 30:] = 1.0
    found = measured("axial_noise", depth, 1e5, offset_m=0, quadratic_per_m=0, steep=0)
    share = (found < 1.5).mean(axis=0)  # the chance that N(0, .8), rounded, reaches the edge
    for column in range(26, 34):
        chance = 0.5 * (1 - math.erf((29.5 - column) / 0.8 / math.sqrt(2)))
        assert share[column] == pytest.approx(chance, abs=0.03)


# --- lidar ---


def test_beams_are_in_rows_and_measure_ranges():
    depth = np.full((400, 500), 2.0)
    camera = camera_of(depth.shape, 500.0)
    found = measured("lidar", depth, step_m=0)
    row, column = np.nonzero(found)
    rays = camera.ray_directions()[row, column]
    elevation = np.degrees(np.arctan2(-rays[:, 1], np.hypot(rays[:, 0], 1)))
    beams = np.arange(-15, 16, 2)
    off_deg = np.abs(elevation[:, None] - beams).min(axis=1)
    assert off_deg.max() <= math.degrees(0.5 / 500) * 1.01  # half a pixel
    assert len({int(np.abs(beams - value).argmin()) for value in elevation}) == 16
    error = found[row, column] * np.linalg.norm(rays, axis=1) - 2.0 * np.linalg.norm(rays, axis=1)
    assert error.std() == pytest.approx(0.03, rel=0.05)
    # 0.2 degrees are 1.75 px in the middle: each beam meets a pixel of its own there.
    middle = np.sort(column[(np.abs(elevation - 1) < 0.06) & (np.abs(rays[:, 0]) < 0.1)])
    assert np.diff(middle).mean() == pytest.approx(500 * math.radians(0.2), rel=0.05)


def test_a_surface_returns_less_light_the_more_obliquely_it_is_met():
    camera = camera_of((200, 200), 1e4)
    values = {"intrinsics": camera, "max_m": 20, "noise": 0, "rows": 40, "below_deg": 0.5, "above_deg": 0.5}
    for z_m, angle, seen in ((19, 0, True), (21, 0, False), (13, 60, True), (15, 60, False)):
        tilt = math.radians(angle)
        depth, _ = plane((math.sin(tilt), 0, math.cos(tilt)), z_m * math.cos(tilt), camera)
        assert apply(depth, "lidar", azimuth_step_deg=0.1, **values)[80:120, 80:120].any() == seen


# --- errors that neighbours and frames share ---


def normal_share(value):
    """The share of normal numbers below a value."""
    return 0.5 * math.erfc(-value / math.sqrt(2))


def context_of(frame, **changes):
    return FrameContext(frame, ("test",), **changes)


@cases(("px", "frames", "share"), [(2.0, 1, 1.0), (3.0, 2, 1.0), (4.0, 1, 0.6), (7.5, 3, 1.0), (0.0, 3, 1.0)])
def test_shared_numbers_are_standard_normal_up_to_the_edges_and_correlated_as_told(px, frames, share):
    fields = np.stack([drawn(context_of(k), "x", (90, 131), SharedNoise(px, frames, share))[0] for k in range(100)])
    assert fields.std() == pytest.approx(1, abs=0.01)
    for edge in (fields[:, 0], fields[:, -1], fields[:, :, 0], fields[:, :, -1]):
        assert edge.std() == pytest.approx(1, abs=0.04)
    assert abs(np.mean(fields**4) - 3) < 0.1
    for tail, most_off in ((1.0, 0.05), (2.0, 0.1), (3.0, 0.4)):
        assert (fields > tail).mean() == pytest.approx(normal_share(-tail), rel=most_off)
    for lag in (1, 2, 4, 8):
        wanted = share * math.exp(-((lag / px) ** 2)) if px else 0.0
        assert np.mean(fields[:, :, lag:] * fields[:, :, :-lag]) == pytest.approx(wanted, abs=0.03)
        assert np.mean(fields[:, lag:] * fields[:, :-lag]) == pytest.approx(wanted, abs=0.03)
        wanted = share * max(1 - lag / frames, 0.0)
        assert np.mean(fields[lag:] * fields[:-lag]) == pytest.approx(wanted, abs=0.03)


def test_what_goes_farther_than_the_image_is_one_number_and_takes_no_more_memory():
    fields = np.stack([drawn(context_of(k), "x", (48, 64), SharedNoise(1e9))[0] for k in range(60)])
    assert np.ptp(fields, axis=(1, 2)).max() < 0.5
    assert fields.std() == pytest.approx(1, abs=0.25)


def test_fields_of_one_purpose_are_independent_and_a_fixed_pattern_stays():
    down, right = drawn(context_of(0), "x", (200, 300), SharedNoise(3.0, 2), count=2)
    assert abs(np.mean(down * right)) < 0.02
    first, later = (drawn(context_of(k, temporal="fixed"), "x", (20, 30), SharedNoise(3.0, 2))[0] for k in (0, 9))
    np.testing.assert_array_equal(first, later)


@cases(
    ("name", "values"),
    [
        ("stereo", {"least_contrast": 0}),
        ("structured_light", {}),
        ("redwood", {}),
        ("time_of_flight", {"spread": 0}),
        ("axial_noise", {}),
    ],
)
def test_a_pixels_deviation_is_the_same_where_neighbours_share_it(name, values):
    """Of 40 frames, since shared errors are fewer numbers; means of 4 x 4 pixels deviate by more than a quarter."""
    white, shared = (
        np.stack(
            [measured(name, np.full((96, 128), 2.03), 500.0, k, **values, **more)[:, 28:] for k in range(0, 80, 2)]
        )
        for more in ({}, {"correlation_px": 3.0, "correlation_frames": 2})
    )
    found = [each[each > 0].std() for each in (white, shared)]
    assert found[1] == pytest.approx(found[0], rel=0.015)
    whole = (shared > 0).all(axis=0).all()
    if whole:
        ratios = [each.reshape(40, 24, 4, 25, 4).mean(axis=(2, 4)).std() / each.std() for each in (white, shared)]
        assert ratios[0] == pytest.approx(0.25, abs=0.02)
        assert ratios[1] > 0.45


def sloping(shape, z_m, steps_across, steps_down):
    """A plane at a depth, whose disparity at 585.5 px and 75 mm changes by so many eighths of a pixel."""
    rows, columns = np.indices(shape)
    eighths = 351.3 / z_m + (columns - shape[1] / 2) * steps_across + (rows - shape[0] / 2) * steps_down
    return 351.3 / eighths


def test_the_measured_kinect_is_as_its_frames_say():
    """What planes of 24 x 24 px leave of real frames' depth (docs/sensors.md), on slopes as they have."""
    found = []
    for frame, (across, down) in enumerate(itertools.product((0.07, 0.14, 0.35, 0.6), (0.04, 0.13, 0.16))):
        depth = sloping((240, 320), 2.1, across, down)
        found.append(measured("structured_light", depth, 585.5, 7 * frame, device="kinect_v1_measured", least_light=0))
    rows, columns = np.indices((24, 24)) - 11.5
    of_plane = np.stack([rows.ravel(), columns.ravel(), np.ones(576)], axis=1)
    left = []
    for depth in found:
        for top, start in itertools.product(range(0, 216, 24), range(48, 264, 24)):
            block = depth[top : top + 24, start : start + 24]
            if (block > 0).all():
                inverse = 1 / block.ravel()
                rest = inverse - of_plane @ np.linalg.lstsq(of_plane, inverse, rcond=None)[0]
                left.append(rest.reshape(24, 24) * 351.3)  # in eighths of a pixel
    left = np.array(left)
    power = np.mean(left**2)
    assert len(left) > 300
    assert 1e3 * math.sqrt(power) * 2.1**2 / 351.3 == pytest.approx(5.5, rel=0.1)
    for lag, wanted in ((1, 0.54), (2, 0.38), (4, 0.13)):
        assert np.mean(left[:, :, lag:] * left[:, :, :-lag]) / power == pytest.approx(wanted, abs=0.1)
    of_four = left.reshape(-1, 6, 4, 6, 4).mean(axis=(2, 4))
    assert math.sqrt(np.mean(of_four**2) / power) == pytest.approx(0.63, rel=0.15)


# --- holes in clumps ---


@cases(
    ("name", "z_m", "angle_deg"),
    [
        ("structured_light", 1.0, 0),
        ("structured_light", 3.5, 0),
        ("structured_light", 2.0, 75),
        ("axial_noise", 2.0, 75),
    ],
)
def test_too_little_light_comes_back_from_far_and_glancing_surfaces(name, z_m, angle_deg):
    camera, tilt = camera_of((120, 160), 5e3), math.radians(angle_deg)
    depth, _ = plane((math.sin(tilt), 0, math.cos(tilt)), z_m * math.cos(tilt), camera)
    values = {"least_light": 0.02, "reflectance_spread": 1.5, "clump_px": 0.5, "noise": 0}
    values |= {"baseline_m": 0.001, "step_px": 0} if name == "structured_light" else {}
    lost = [apply(depth, name, seed=2, frame=frame, intrinsics=camera, **values) == 0 for frame in range(20)]
    light = math.cos(tilt) / z_m**2
    assert np.mean(lost) == pytest.approx(normal_share(math.log(0.02 / light) / 1.5), abs=0.02)


@cases("name", ["structured_light", "axial_noise"])
def test_strips_at_the_sides_give_nothing(name):
    strips = {"blind_px": 3, "blind_left_px": 2, "blind_top_px": 1, "blind_bottom_px": 4}
    found = measured(name, np.full((20, 30), 1.5), 585.5, noise=0, **strips) > 0
    inside = np.zeros((20, 30), np.bool_)
    inside[1:16, 2:27] = True
    assert not found[~inside].any()
    assert found[8, 12]


def clumps_of(lost):
    import cv2

    return np.sort(cv2.connectedComponentsWithStats(lost.astype(np.uint8), connectivity=4)[2][1:, cv2.CC_STAT_AREA])


@cases(
    ("name", "z_m", "values"),
    [
        ("structured_light", 3.5, {"least_light": 0.01, "reflectance_spread": 2.0}),
        ("stereo", 3.3, {"sigma_px": 0.0}),
    ],
)
def test_holes_are_as_many_but_in_clumps(name, z_m, values):
    share, middling = [], []
    for clump_px in (1.0, 16.0):
        lost = [
            measured(name, np.full((240, 320), z_m), 500.0, k, clump_px=clump_px, **values)[:, 60:] == 0
            for k in range(24)
        ]
        share.append(np.mean(lost))
        sizes = np.concatenate([clumps_of(each) for each in lost])
        middling.append(sizes[np.searchsorted(np.cumsum(sizes), sizes.sum() / 2)])  # half of what is lost is in larger
    assert share[1] == pytest.approx(share[0], abs=0.03)
    assert 0.1 < share[0] < 0.6
    assert middling[1] > 150
    assert middling[1] > 5 * middling[0]


def test_a_d435_sees_a_white_wall_at_two_metres():
    """Intel's data sheet asks for 99 % there; of farther walls no figure was found."""
    for device in ("realsense_d435", "realsense_d435_correlated"):
        wall = np.full((200, 300), 2.0)
        found = measured("stereo", wall, 424.0, rgb=np.full((200, 300, 3), 0.9, np.float32), device=device)
        assert (found[:, 20:] > 0).mean() > 0.99


def test_records_tell_a_later_parameter_only_where_it_is_given():
    stereo = registry()["stereo"].parameters
    assert "correlation_px" not in deciding(stereo())
    assert deciding(stereo(correlation_px=0.0))["correlation_px"] == 0.0
    assert deciding(stereo())["sigma_px"] == -1.0


# --- all of them ---


@cases(
    ("name", "values"),
    [
        *((name, {}) for name in SENSORS),
        ("axial_noise", {"device": "kinect_v1_law"}),
        ("redwood", {"correlation_px": 9.0}),
        ("stereo", {"device": "realsense_d435_correlated"}),
        ("structured_light", {"device": "kinect_v1_measured"}),
        ("time_of_flight", {"multipath": 1.0, "correlation_px": 3.0, "correlation_share": 0.5}),
    ],
)
def test_void_and_odd_images_stay_what_they_are(name, values):
    for height, width in itertools.product((1, 2, 7), (1, 3, 41)):
        for level in (0.0, 1.3):
            depth = np.full((height, width), level, np.float32)
            depth[0, 0] = 0
            for focal_px in (3.0, 700.0):
                found = measured(name, depth, focal_px, **values)
                assert np.isfinite(found).all()
                assert found.min() >= 0
                assert not found[depth == 0].any()


@cases("name", [name for name in SENSORS if name != "redwood"])
def test_without_intrinsics_the_sensor_says_what_it_needs(name):
    item = registry()[name]
    context = FrameContext(0, ("test",), read_rgb=lambda: np.zeros((4, 4, 3), np.float32))
    refused(
        item.apply,
        np.ones((4, 4), np.float32),
        item.parameters(),
        context,
        names=f"{name} needs the camera's intrinsics",
        error=TypeError,
    )
