# SPDX-License-Identifier: GPL-3.0-or-later
"""Drops on the lens against ray optics and the laws of their sizes, places and ages."""

from dataclasses import replace

import numpy as np
import pytest
from cases import cases
from scipy import stats

from noisy_world.core.geometry import Intrinsics
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.perturbations.shipped import _drops as laws
from noisy_world.perturbations.shipped import lens_drops
from noisy_world.perturbations.shipped._drops import WATER, bent
from noisy_world.perturbations.shipped._drops import runs_on
from noisy_world.perturbations.shipped._drops import DropSheet
from noisy_world.perturbations.shipped._drops import cells_of, refracted, shares, sheets
from noisy_world.perturbations.shipped._glass import pane, reduced
from noisy_world.perturbations.shipped._noise import WhiteNoise

ITEM = lens_drops.PERTURBATION
STILL = {"run_px": 0.0, "drying": 0.0}


def picture(height=60, width=90):
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    return np.stack([columns / width, rows / height, 0.5 + 0.4 * np.sin(columns / 7)], axis=2).astype(np.float32)


def seen(rgb, index=0, temporal="drift", seed=1, intrinsics=None, **values):
    context = FrameContext(index, (seed, "scene", "setting"), temporal, intrinsics=intrinsics)
    return ITEM.apply(rgb, ITEM.at_severity(values.pop("severity", 3), **values), context)


# --- one drop ---


def traced(rho, contact_deg):
    """The direction (right, ahead) of a ray behind a cap, and the share of light: vectors, and Fresnel's sine rules."""
    curvature = 1 / np.sin(np.radians(contact_deg))
    normal = np.array([rho, np.sqrt(curvature**2 - rho**2)]) / curvature
    ray = np.array([0.0, 1.0])
    cosine = ray @ normal
    left = 1 - WATER**2 * (1 - cosine**2)
    if left <= 0:
        return None, 0.0
    out = WATER * ray + (np.sqrt(left) - WATER * cosine) * normal
    alpha, beta = np.arccos(cosine), np.arccos(np.sqrt(left))
    if alpha < 1e-4:
        return out, 1 - ((WATER - 1) / (WATER + 1)) ** 2
    across = (np.sin(alpha - beta) / np.sin(alpha + beta)) ** 2
    along = (np.tan(alpha - beta) / np.tan(alpha + beta)) ** 2
    return out, 1 - (across + along) / 2


@cases("contact_deg", [5.0, 30.0, 60.0, 90.0])
def test_a_cap_bends_light_as_snell_and_fresnel_say(contact_deg):
    rho = np.linspace(0, 0.999, 60, dtype=np.float32)
    found = bent(rho, np.sin(np.radians(contact_deg)))
    for place, tangent, passes in zip(rho.astype(float), found.tangent, found.passes, strict=True):
        direction, share = traced(place, contact_deg)
        assert passes == pytest.approx(share, abs=3e-3)
        if direction is not None and share > 0.1:
            assert tangent == pytest.approx(-direction[0] / direction[1], abs=3e-4)
    assert np.isfinite(found.tangent).all()


def one_drop(shape, middle, radius_px, **values):
    """What one round drop shows of a picture (H, W, 3) of linear light: (h, w, 4)."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float32) + 0.5
    sheet = DropSheet.of(pane(shape, 0.0), 1e9, (np.float32(0),) * 4)
    aside, down = ((a - m) / radius_px for a, m in ((columns, middle[0]), (rows, middle[1])))
    near = np.flatnonzero(np.hypot(aside, down).ravel() < 1)
    sheet.paint(near, aside.ravel()[near], down.ravel()[near])
    return sheet, ITEM.at_severity(3, **values)


def test_a_drop_shows_the_scene_upside_down_and_smaller():
    """Near its middle as a thin lens of focal length R / (n - 1) does; as dark as Fresnel says."""
    shape, middle, radius_px, focal_px = (200, 300), (150.0, 100.0), 60.0, 400.0
    sheet, parameters = one_drop(shape, middle, radius_px, contact_deg=40.0, rim=0.0, glint=0.0)
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float32) + 0.5
    linear = np.stack([columns / 300, rows / 200, np.ones_like(rows)], axis=2)
    small = reduced(linear, 3)
    layer = refracted(small, small.mean(axis=(0, 1)), sheet, focal_px, parameters)
    cover = layer[..., 3]
    assert cover.sum() == pytest.approx(np.pi * radius_px**2, rel=0.01)
    assert not layer[cover == 0].any()
    x, y = layer[100, 150:156, 0] / layer[100, 150:156, 2] * 300, layer[100:106, 150, 1] / layer[100:106, 150, 2] * 200
    wanted = 1 - focal_px * (WATER - 1) * np.sin(np.radians(40)) / radius_px  # the magnification, below 0: flipped
    assert wanted < -0.25
    assert np.diff(x) == pytest.approx([wanted] * 5, rel=0.08)
    assert np.diff(y) == pytest.approx([wanted] * 5, rel=0.08)
    assert layer[100, 150, 2] == pytest.approx(1 - ((WATER - 1) / (WATER + 1)) ** 2, abs=1e-3)
    assert layer[100, 150 + 57, 2] < 0.98 * layer[100, 150, 2]


def test_a_steep_drop_s_rim_lets_nothing_through_but_reflects():
    sheet, parameters = one_drop((80, 80), (40.0, 40.0), 30.0, contact_deg=80.0, rim=0.5, glint=0.0)
    small = np.full((10, 10, 3), 0.4, np.float32)
    layer = refracted(small, small.mean(axis=(0, 1)), sheet, 40.0, parameters)
    assert layer[40, 40 + 28, 0] == pytest.approx(0.2, abs=1e-6)  # half of the scene's mean
    assert layer[40, 40, 0] == pytest.approx(0.4 * 0.98 + 0.2 * 0.02, abs=2e-3)


# --- many drops ---


def test_light_gathers_at_the_lower_edge_of_drops_alone():
    """Before an even wall: nothing darker, nothing beside drops, and in a single drop a crescent below its middle."""
    wall = np.full((120, 160, 3), 0.5, np.float32)
    given = {"severity": 5, "focus_px": 0.0, "runs": 0.0}
    without, found = (seen(wall, caustic=caustic, **given) for caustic in (0.0, 2.0))
    gained = (found - without)[..., 0]
    assert gained.min() >= 0
    assert gained.max() > 0.2
    assert not gained[np.abs(without[..., 0] - 0.5) < 1e-6].any()
    rho, angle = np.meshgrid(np.linspace(0, 1, 101), np.radians(np.arange(360)), indexing="ij")
    one = laws.crescent(rho.astype(np.float32), np.sin(angle).astype(np.float32))
    assert not one[:, np.sin(angle[0]) <= 0].any()
    at = np.unravel_index(one.argmax(), one.shape)
    assert (rho[at], np.degrees(angle[at])) == pytest.approx((0.78, 90), abs=0.02)


@cases("coverage", [0.05, 0.2])
def test_drops_cover_what_is_asked_for(coverage):
    parameters = ITEM.at_severity(3, coverage=coverage, runs=0.0, focus_px=0.0, size_px=10.0)
    glass = pane((300, 400), 0.0)
    found = [
        np.mean(sheet.rho_squared < 1)
        for seed in range(12)
        for _, sheet in sheets(glass, parameters, WhiteNoise(seed, 0), 0)
    ]
    # A large drop has taken in its neighbours, so a little less is covered.
    assert 0.8 * coverage < np.mean(found) < 1.05 * coverage


def test_diameters_are_log_normal_and_areas_fall_steadily():
    parameters = ITEM.at_severity(3, coverage=0.05, size_px=20.0, spread=0.6)
    octaves, dense = [], []
    for number, share in enumerate(shares(parameters)):
        cells = cells_of(number, parameters, (4000, 3000), WhiteNoise(5, 0), 0)
        octaves.append(share / (laws.of_class(number).cell * 400))
        dense.append((cells.drop >= 0).mean() / share)
        radius_px = 1 / cells.per_px
        largest = laws.LARGEST * 0.5**number * 20
        assert (2 * radius_px < largest).all()
        # The radius squared is that of a log-uniform diameter times a uniform rest.
        rng = np.random.default_rng(1)
        wanted = (largest / 2 * 0.5 ** rng.random(20_000)) * np.sqrt(rng.random(20_000))
        assert stats.ks_2samp(radius_px, wanted).pvalue > 0.001
    bounds = stats.norm.cdf(np.log([4, 2, 1, 0.5, 0.25]) / 0.6)
    wanted = -np.diff(bounds) / -np.diff(bounds).sum()
    assert np.array(octaves) / sum(octaves) == pytest.approx(wanted, abs=0.012)
    assert np.array(dense[1:]) == pytest.approx(1, abs=0.1)


def test_a_drop_lies_in_its_cell_and_dries_by_the_square_of_its_size():
    parameters = ITEM.at_severity(3, coverage=0.2, drying=0.001)
    first, later = (cells_of(1, parameters, (900, 700), WhiteNoise(3, 0), frames) for frames in (0, 60))
    both = (first.drop >= 0) & (later.drop >= 0)
    one, other = first.drop[both], later.drop[both]
    same = first.aside_px[one] == later.aside_px[other]
    assert same.sum() > 50
    lost = 1 - (first.per_px[one] / later.per_px[other])[same] ** 2
    assert (lost > 0).all()
    # Within the paces of a class, which differ by a factor of three: frames times the rate, of the whole area.
    whole = laws.drying_rate(1) * 0.001 * 60
    assert (lost > 0.5 * whole).all()
    assert np.median(lost) < 4 * whole
    width_px, height_px = first.size_px
    radius_px = 1 / first.per_px
    assert (first.aside_px - radius_px > -1e-3).all()
    assert (first.aside_px + radius_px < width_px + 1e-3).all()
    assert (first.down_px + radius_px * laws.TALL[1] < height_px + 1e-3).all()


def test_drops_run_down_at_their_speed_and_never_up():
    parameters = ITEM.at_severity(3, runs=1.0, run_px=3.0)
    size_px = (20_000, 600)
    at = [runs_on(size_px, parameters, WhiteNoise(2, 0), frames) for frames in (0, 1, 40)]
    steps = at[1].at_px - at[0].at_px
    kept = at[0].number == at[2].number
    assert kept.sum() > 100
    assert (steps[kept] >= 0).all()
    moving = kept & (steps > 0)
    assert (at[2].at_px - at[0].at_px)[moving].mean() / 40 == pytest.approx(3.0 * 0.75, rel=0.3)
    still = runs_on(size_px, replace(parameters, run_px=0.0), WhiteNoise(2, 0), 5000)
    assert np.array_equal(still.at_px, at[0].at_px)


# --- over time ---


def test_drops_that_neither_run_nor_dry_stay():
    rgb = picture()
    assert np.array_equal(seen(rgb, 0, **STILL), seen(rgb, 100_000, **STILL))


def test_most_of_the_glass_holds_still_from_frame_to_frame():
    rgb = picture(120, 200)
    values = {"severity": 5, "size_px": 8.0, "focus_px": 1.0}
    first, second, fresh = seen(rgb, 7, **values), seen(rgb, 8, **values), seen(rgb, 8, "fresh", **values)
    assert 0 < np.abs(first - second).mean() < 0.15 * np.abs(first - fresh).mean()


# --- over the image ---


def test_no_drops_change_no_bit_and_drops_none_beside_them():
    rgb = picture()
    assert np.array_equal(seen(rgb, coverage=0.0, runs=0.0), rgb)
    found = seen(rgb, size_px=8.0, focus_px=1.0)
    untouched = (found == rgb).all(axis=2)
    assert 0.3 < untouched.mean() < 1


def test_a_narrow_camera_sees_less_of_the_scene_in_a_drop():
    rgb = picture()
    wide, narrow = Intrinsics(90, 60, 45.0, 45.0, 44.5, 29.5), Intrinsics(90, 60, 150.0, 150.0, 44.5, 29.5)
    values = {"severity": 5, "size_px": 12.0}
    assert np.array_equal(seen(rgb, **values), seen(rgb, intrinsics=wide, **values))
    assert not np.array_equal(seen(rgb, **values), seen(rgb, intrinsics=narrow, **values))
    assert ITEM.nodes.by_camera(wide)["view_deg"] == pytest.approx(90)
