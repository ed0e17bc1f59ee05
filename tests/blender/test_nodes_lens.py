"""The lens's node groups beside their references, closed forms and laws of offsets."""

import math
from functools import partial

import cv2
import numpy as np
import pytest
from cases import cases
from group_tools import by_nodes, by_reference, levels_apart, many_by_nodes, picture, step_of

from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.shipped import defocus_depth
from noisy_world.perturbations.shipped._arrays import disk_kernel
from noisy_world.perturbations.shipped.glass_blur import offset_shares

SEVERITIES = (1, 2, 3, 4, 5)
SIZES = [(1, 1), (1, 7), (7, 1), (2, 3), (31, 45)]
NAMES = ("defocus_blur", "defocus_depth", "gaussian_blur", "glass_blur", "motion_blur")


def depth_of(image):
    """Void, near, in focus and far."""
    places = np.arange(image.shape[0] * image.shape[1]).reshape(image.shape[:2])
    return np.choose(places // 5 % 5, [0.0, 0.4, 1.5, 2.5, 6.0]).astype(np.float32)


def each(image, given, depth_m=None):
    """What the nodes and the references make of (name, values), the nodes in one evaluation."""
    chains = {f"{place}": [step_of(name, **values)] for place, (name, values) in enumerate(given)}
    (made,) = many_by_nodes(chains, [image], depth_m=depth_m)
    expected = [
        by_reference(name, image, depth_m=depth_m if name == "defocus_depth" else None, **values)[0]
        for name, values in given
    ]
    return list(made.values()), expected


def assert_equal(image, given, depth_m=None):
    for (name, values), one, other in zip(given, *each(image, given, depth_m), strict=True):
        assert levels_apart(one, other)[0] < 1, (name, values)


@pytest.fixture(scope="module")
def frame():
    return picture(67, 93)


@cases("name", ["defocus_blur", "gaussian_blur", "zoom_blur"])
def test_blurs_are_their_references_up_to_the_border(name, frame):
    assert_equal(frame, [(name, {"severity": severity}) for severity in SEVERITIES])


QUICK = {"bloom": {}, "defocus_blur": {}, "motion_blur": {"max_angle_deg": 0, "angle_deg": 33}, "zoom_blur": {}}


@cases("name", QUICK)
def test_quick_blurs_are_their_references_and_hardly_others(name, frame):
    quick = [(name, {"severity": severity, "coarse": True, **QUICK[name]}) for severity in (3, 5)]
    made, expected = each(frame, quick)
    for one, other, severity in zip(made, expected, (3, 5), strict=True):
        assert levels_apart(one, other)[0] < 1
        (exact,) = by_reference(name, frame, severity=severity, **QUICK[name])
        assert 0 < np.abs(other - exact).mean() < 0.15 * np.abs(exact - frame).mean()


def test_a_disk_of_any_radius(frame):
    disks = [(0, 0), (0.5, 0.3), (2.5, 0.1), (7.3, 1.2)]
    assert_equal(frame, [("defocus_blur", {"radius_px": radius, "alias_sigma_px": alias}) for radius, alias in disks])


def test_a_trail_at_a_given_angle(frame):
    given = [{"max_angle_deg": 0, "angle_deg": angle} for angle in (0, 17, 45, -30, 60, 90, 133, 180)]
    assert_equal(frame, [("motion_blur", {"severity": 5, **values}) for values in given])


def test_a_trail_at_every_severity(frame):
    given = {"max_angle_deg": 0, "angle_deg": -20}
    assert_equal(frame, [("motion_blur", {"severity": severity, **given}) for severity in SEVERITIES[:4]])


def test_a_trail_longer_than_the_group_serves_by_itself(frame):
    given = {"radius_px": 30, "sigma_px": 40.0, "max_angle_deg": 0, "angle_deg": 70}
    assert_equal(frame, [("motion_blur", given)])


def test_the_trails_angle_is_uniform():
    point = np.zeros((51, 51, 3), dtype=np.float32)
    point[25, 25] = 1
    spreads = by_nodes("motion_blur", point, range(60), radius_px=12, sigma_px=100.0, angle_deg=60)
    rows, columns = np.mgrid[-25:26, -25:26]
    # The point is smeared against the direction: what lies there is what a pixel sees later.
    found = [
        math.degrees(math.atan2(-(item[..., 0] * rows).sum(), -(item[..., 0] * columns).sum())) for item in spreads
    ]
    turns = np.array(found) - 60
    assert np.abs(turns).max() < 47
    below = np.array([(turns < limit).mean() for limit in range(-40, 41, 10)])
    uniform = (np.arange(-40, 41, 10) + 45) / 90
    assert np.abs(below - uniform).max() < 1.63 / math.sqrt(len(turns)) + 0.02


def places(height, width):
    """A picture of where each pixel is: columns in red, rows in green."""
    image = np.zeros((height, width, 3), dtype=np.float32)
    image[..., 0], image[..., 1] = np.arange(width) / 256, np.arange(height)[:, None] / 256
    return image


def offsets_taken(image, made):
    """Columns to the right and rows down, of each pixel's place from its own."""
    return [(made[..., k] - image[..., k]) * 256 for k in (0, 1)]


@cases("delta", [1, 2, 4])
def test_glass_takes_pixels_from_where_the_loop_does(delta):
    image = places(240, 250)
    columns, rows = offsets_taken(image, by_nodes("glass_blur", image, sigma_px=0, max_delta_px=delta, iterations=1)[0])
    inner = slice(10 * delta, -10 * delta)
    columns, rows = columns[inner, inner].ravel(), rows[inner, inner].ravel()
    assert np.abs(columns - np.rint(columns)).max() < 1e-3
    shares = offset_shares(delta)
    reach = shares.shape[0] // 2
    counts = np.zeros_like(shares)
    np.add.at(counts, (np.rint(rows).astype(int) + reach, np.rint(columns).astype(int) + reach), 1)
    likely = shares * counts.sum() > 10
    chi_squared = ((counts - shares * counts.sum()) ** 2 / (shares * counts.sum()).clip(1e-9))[likely].sum()
    kinds = np.count_nonzero(likely)
    assert chi_squared < kinds + 4 * math.sqrt(2 * kinds)
    assert counts[shares == 0].sum() == 0
    for line in (rows, columns):
        width = 250 - 20 * delta
        assert abs(np.corrcoef(line[:-width], line[width:])[0, 1]) < 5 / math.sqrt(line.size)
        assert abs(np.corrcoef(line[:-1], line[1:])[0, 1]) < 5 / math.sqrt(line.size)


def test_glass_goes_far_and_often():
    image = places(200, 220)
    once, thrice, six = (
        offsets_taken(image, by_nodes("glass_blur", image, sigma_px=0, max_delta_px=10, iterations=count)[0])
        for count in (1, 3, 6)
    )
    inner = slice(60, -60)
    for few, many, factor in ((once, thrice, 3), (thrice, six, 2)):
        for one, other in zip(few, many, strict=True):
            assert other[inner, inner].var() == pytest.approx(factor * one[inner, inner].var(), rel=0.15)


def test_glass_without_a_shuffle_is_two_blurs(frame):
    still = [{"max_delta_px": 0, "iterations": 3}, {"max_delta_px": 4, "iterations": 0}]
    assert_equal(frame, [("glass_blur", {"sigma_px": 1.5, **values}) for values in still])


def test_glass_changes_as_much_as_its_reference():
    image = picture(160, 240)
    for one, other in zip(*each(image, [("glass_blur", {"severity": level}) for level in SEVERITIES]), strict=True):
        errors = [np.mean((item - image) ** 2) for item in (one, other)]
        assert 10 * math.log10(errors[0] / errors[1]) == pytest.approx(0, abs=0.25)
        assert abs(one.mean() - other.mean()) * 255 < 0.3


def test_a_preview_of_glass_shows_means_of_the_same_places():
    image, half = places(120, 160), places(60, 80)
    values = {"sigma_px": 0, "max_delta_px": 4, "iterations": 1, "reference_width": 160}
    full = offsets_taken(image, by_nodes("glass_blur", image, **values)[0])
    small = offsets_taken(half, by_nodes("glass_blur", half, **values)[0])
    for one, other in zip(full, small, strict=True):
        means = one.reshape(60, 2, 80, 2).mean(axis=(1, 3)) / 2
        # Half of the 0.25 px that a pixel of the frame is beside the preview's: edges are drawn steeper than they are.
        assert np.abs(means - other)[10:-10, 10:-10].max() < 0.13


# --- depth of field ---


def focused(**values):
    return defocus_depth.DefocusDepth(**values)


def blurred(image, depth_m, **values):
    return defocus_depth.apply(image, focused(**values), FrameContext(0, (0,), read_depth_m=lambda: depth_m))


def test_depth_of_field_is_its_reference(frame):
    name = "defocus_depth"
    given = [(name, {"severity": level, "focal_length_mm": 300.0 + 100 * level}) for level in SEVERITIES]
    quick = [(name, values | {"coarse": True}) for name, values in given[::2]]
    assert_equal(frame, given + quick, depth_of(frame))


def test_depth_of_field_on_a_slope_and_with_another_limit(frame):
    slope = np.linspace(0.3, 4, frame.shape[1], dtype=np.float32)[None].repeat(frame.shape[0], axis=0)
    values = {"focal_length_mm": 400.0, "max_radius_px": 6.5, "focus_m": 1.2}
    made, expected = (make("defocus_depth", frame, depth_m=slope, **values)[0] for make in (by_nodes, by_reference))
    assert levels_apart(made, expected)[0] < 1
    odd = frame[:-1, :-1]
    quick = blurred(odd, slope[:-1, :-1], coarse=True, **values)
    assert levels_apart(by_nodes("defocus_depth", odd, depth_m=slope[:-1, :-1], coarse=True, **values)[0], quick)[0] < 1
    exact = blurred(odd, slope[:-1, :-1], **values)
    assert np.abs(quick - exact).mean() < 0.15 * np.abs(exact - odd).mean()


@cases(
    ("z_m", "focus_m", "f_number", "focal_mm", "diameter_mm"),
    # By the image distances v = f z / (z - f): diameter = f / N * |v_z - v_s| / v_z, worked out by hand.
    [
        (4.0, 2.0, 2.0, 50.0, 0.320513),
        (1.0, 2.0, 2.0, 50.0, 0.641026),
        (3.0, 3.0, 4.0, 85.0, 0.0),
        (0.0, 1.0, 1.0, 20.0, 0.408163),
    ],
)
def test_the_circle_of_confusion_is_the_thin_lens_s(z_m, focus_m, f_number, focal_mm, diameter_mm):
    parameters = focused(focus_m=focus_m, f_number=f_number, focal_length_mm=focal_mm, max_radius_px=30)
    found = defocus_depth.confusion_radius_px(np.full((1, 1), z_m, np.float32), parameters, 1200)
    assert found[0, 0] == pytest.approx(diameter_mm / 36 * 1200 / 2, abs=2e-3)
    if z_m > 0:
        sharp, seen = (focal_mm * d * 1000 / (d * 1000 - focal_mm) for d in (focus_m, z_m))
        assert found[0, 0] == pytest.approx(focal_mm / f_number * abs(seen - sharp) / seen / 36 * 600, abs=2e-3)


def test_what_is_in_focus_is_untouched(frame):
    plane = np.full(frame.shape[:2], 1.5, np.float32)
    made = by_nodes("defocus_depth", frame, depth_m=plane, severity=5, focal_length_mm=700.0)[0]
    assert np.array_equal(made, frame)
    assert np.array_equal(blurred(frame, plane, focal_length_mm=700.0), frame)


def test_a_far_plane_has_a_disk_s_blur():
    point = np.zeros((41, 41, 3), dtype=np.float32)
    point[20, 20] = 1
    void = np.zeros((41, 41), np.float32)
    radii = (2, 3.5, 5, 7, 8)
    lens = {"focus_m": 1.05, "f_number": 1.0, "focal_length_mm": 50.0, "max_radius_px": 8.0}
    # A sensor so wide that a point at infinity has this radius: its circle is 2.5 mm across.
    given = [("defocus_depth", lens | {"sensor_width_mm": 2.5 * 41 / 2 / radius}) for radius in radii]
    offsets = np.arange(-20, 21)
    distance = np.hypot(offsets[:, None], offsets)
    for radius, made in zip(radii, each(point, given, void)[0], strict=True):
        spread = made[..., 0]
        assert spread.sum() == pytest.approx(1, abs=1e-4)
        variance = (spread.sum(axis=0) * offsets**2).sum()
        assert math.sqrt(variance) == pytest.approx(radius / 2, rel=0.08)
        assert np.ptp(spread[distance < radius - 1.2]) < 1e-6
        assert spread[distance > radius + 1.2].max() < 1e-6
        disk = np.zeros_like(spread)
        reach = int(radius)
        disk[20 - reach : 21 + reach, 20 - reach : 21 + reach] = disk_kernel(radius)
        assert np.abs(spread - disk).sum() < 0.35
    for radius in radii:
        made = blurred(point, void, coarse=True, sensor_width_mm=2.5 * 41 / 2 / radius, **lens)[..., 0]
        assert made.sum() == pytest.approx(1, abs=1e-4)
        place = (made.sum(axis=0) * offsets).sum()  # of a pair of pixels' middle
        variance = (made.sum(axis=0) * (offsets - place) ** 2).sum()
        assert math.sqrt(variance) == pytest.approx(radius / 2, rel=0.08)


def test_what_is_sharp_does_not_bleed_into_what_is_blurred():
    image = np.zeros((40, 60, 3), dtype=np.float32)
    image[:, :30] = 1
    depth_m = np.full((40, 60), 6.0, np.float32)
    depth_m[:, :30] = 1.5
    made = by_nodes("defocus_depth", image, depth_m=depth_m, severity=5, focal_length_mm=700.0)[0]
    assert np.array_equal(made[:, :30], image[:, :30])
    assert made[:, 30:].max() < 0.02


# --- all of them ---


@cases("size", SIZES)
def test_any_size(size):
    image = picture(40, 50)[: size[0], -size[1] :]
    given = [(name, {"severity": 5}) for name in NAMES]
    for name, one, other in zip(NAMES, *each(image, given, depth_of(image)), strict=True):
        assert one.shape == image.shape
        assert np.isfinite(one).all()
        assert name in ("glass_blur", "motion_blur") or levels_apart(one, other)[0] < 1


@cases("level", [0.0, 1.0])
def test_a_constant_frame_stays(level):
    flat = np.full((20, 30, 3), level, dtype=np.float32)
    for made in each(flat, [(name, {"severity": 4}) for name in NAMES], depth_of(flat))[0]:
        assert levels_apart(made, flat)[0] < 0.01


@cases("quick", [False, True])
def test_elastic_nodes_displace_by_the_law_of_the_reference(quick):
    """Strength and correlation of the displacement, inside and at the border, where noise is mirrored."""
    image = places(150, 200)
    laws = []
    values = {"alpha": 50.0, "sigma_share": 0.03} if quick else {"severity": 4}
    makes = [
        partial(make, coarse=True, **values) if quick else partial(make, **values) for make in (by_nodes, by_reference)
    ]
    frames = range(64 if quick else 8)  # wide waves are few along the border
    for make in [*makes, partial(by_reference, **values)][: 2 + quick]:
        fields = np.array([offsets_taken(image, one) for one in make("elastic_transform", image, frames)])
        inner = fields[..., 12:-12, 12:-12]
        beside = [(inner[..., k:] * inner[..., :-k]).mean() / (inner**2).mean() for k in (1, 3)]
        below = [(inner[..., k:, :] * inner[..., :-k, :]).mean() / (inner**2).mean() for k in (1, 3)]
        border = fields[:, 0, 0, 12:-12].std(), fields[:, 1, 12:-12, 0].std()  # along the border, where it may
        laws.append([inner.std(), *beside, *below, *border])
    for law in laws[1:]:
        assert (np.abs(np.divide(law, laws[0]) - 1) < 0.1).all(), (law, laws[0])


@cases("name", ["zoom_blur", "elastic_transform"])
def test_a_preview_shows_the_zoom_and_the_waves_of_the_frame(name):
    smooth = cv2.GaussianBlur(picture(120, 160), (0, 0), 3)
    small = cv2.resize(smooth, (80, 60), interpolation=cv2.INTER_AREA)
    full = cv2.resize(by_nodes(name, smooth, severity=5)[0], (80, 60), interpolation=cv2.INTER_AREA)
    preview = by_nodes(name, small, severity=5, reference_width=160)[0]
    assert np.abs(preview - full).mean() < 0.05 * np.abs(full - small).mean()
    larger = by_nodes(name, smooth, severity=5, reference_width=80)[0]  # of more pixels than the frame has
    own = by_nodes(name, small, severity=5)[0]
    assert np.abs(larger - smooth).mean() == pytest.approx(np.abs(own - small).mean(), rel=0.15)
