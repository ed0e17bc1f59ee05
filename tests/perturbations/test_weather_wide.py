# SPDX-License-Identifier: GPL-3.0-or-later
"""Snow and rain by depth before cameras that see very wide: cost has a bound, and ordinary cameras keep all."""

import math
from dataclasses import replace

import numpy as np
from cases import cases
from worlds import write_world

from noisy_world.core.geometry import Intrinsics, rotation_from_euler_deg
from noisy_world.dataset.plan import plan_notes
from noisy_world.preset.keys import read_preset
from noisy_world.perturb import apply
from noisy_world.perturbations.shipped import _particles, _weather, rain_depth, snow_depth
from noisy_world.perturbations.shipped._particles import AirCamera, in_sight
from noisy_world.perturbations.shipped._weather import Lens, optical_depth, streaks_of
from noisy_world.perturbations.shipped._weather import drawn_air
from noisy_world.dataset.plan import make_plan

MODULES = {"snow_depth": snow_depth, "rain_depth": rain_depth}
MOVING = {"velocity_m_s": np.array([1.0, 0.2, 3.0]), "turning_rad_s": np.array([0.1, 0.5, 0.0])}


def camera(degrees, size=(160, 120)):
    focal_px = size[0] / 2 / math.tan(math.radians(degrees / 2))
    return Intrinsics(*size, focal_px, focal_px, (size[0] - 1) / 2, (size[1] - 1) / 2)


def view_of(seen, rotation=None, **moving):
    lens = ((seen.fx_px, seen.fy_px), (seen.cx_px, seen.cy_px), (seen.width_px, seen.height_px))
    still = {"velocity_m_s": np.zeros(3), "turning_rad_s": np.zeros(3), **moving}
    turned = np.eye(3) if rotation is None else rotation
    return AirCamera(turned, np.array([3.0, -50.0, 7.0]), **still, focal_px=lens[0], middle_px=lens[1],
                     size_px=lens[2], farthest_m=5.0, exposure_s=0.008)  # fmt: skip


@cases("angles_deg", [(0, 0, 0), (20, 130, -35), (90, 0, 0), (0, 90, 0), (0, 0, 45)])
def test_columns_between_the_faces_hold_the_cubes_that_the_whole_box_does(angles_deg, monkeypatch):
    """In the same order, so that every image keeps its bytes."""
    seen = view_of(camera(140), rotation_from_euler_deg(*map(float, angles_deg)), **MOVING)
    moved_m = np.array([0.3, 11.7, 0.0])
    found = []
    for many in (1 << 30, 200):
        monkeypatch.setattr(_particles, "MANY_CUBES", many)
        found.append(list(_particles._cells_in_sight(seen, moved_m, 0.3, 4.0, 0.2)))
    assert len(found[0]) == 1
    assert len(found[1]) > 5
    np.testing.assert_array_equal(np.concatenate(found[1], axis=1), found[0][0])
    # And those are the ones whose centres are near what is seen, by the definition.
    centre_m = (found[0][0].T + 0.5) * 0.3 + moved_m - seen.position_m
    assert (np.abs(centre_m) < 40).all()


@cases("name", MODULES)
def test_streaks_are_summed_alike_in_any_number_of_pieces(name, monkeypatch):
    view = view_of(camera(100))
    air = MODULES[name].KIND.air(MODULES[name].PERTURBATION.at_severity(5))
    streaks = streaks_of(in_sight(air, view, 5, 2.0), view, Lens(0.002, 5.0))
    depth_m = np.full((120, 160), 5.0, np.float32)
    whole = optical_depth(streaks, depth_m)
    monkeypatch.setattr(_weather, "MOST_FOUND", 100)
    assert whole.any()
    np.testing.assert_array_equal(optical_depth(streaks, depth_m), whole)


@cases("name", MODULES)
@cases("degrees", [40, 90, 150])
def test_what_is_expected_is_what_is_looked_at(name, degrees, monkeypatch):
    """The estimate, beside the cubes and the particles that are made of them."""
    counted = [0]
    draw = _particles._poisson

    def counting(hashes, mean):
        counts = draw(hashes, mean)
        counted[0] += len(counts) + int(counts.sum())
        return counts

    monkeypatch.setattr(_particles, "_poisson", counting)
    parameters = MODULES[name].PERTURBATION.at_severity(5)
    air = MODULES[name].KIND.air(parameters)
    view = replace(view_of(camera(degrees)), farthest_m=np.inf, exposure_s=parameters.shutter_ms * 1e-3)
    in_sight(air, view, 5, 2.0)
    expected = _particles.looked_at(air, view.slopes(), view.exposure_s)
    assert 0.9 * counted[0] < expected < 1.5 * counted[0]  # near the lens the box is smaller


@cases("name", MODULES)
def test_ordinary_cameras_see_all_that_is_asked_for_and_any_camera_is_bounded(name):
    kind, strongest = MODULES[name].KIND, MODULES[name].PERTURBATION.at_severity(5)
    for degrees in (30, 60, 90, 120, 150):
        for size in ((64, 48), (1200, 680)):
            assert drawn_air(kind, strongest, camera(degrees, size)).least_rad == 1e-3
    hostile = replace(strongest, rate_mm_h=500.0, least_mrad=0.2, reach_m=200.0, wind_m_s=50.0, shutter_ms=1000.0)
    for parameters in (strongest, hostile):
        for focal_px in (7.0, 1.0, 0.5, 1e-3, 1e-6):
            seen = Intrinsics(160, 120, focal_px, focal_px, 79.5, 59.5)
            air, view = drawn_air(kind, parameters, seen), view_of(seen)
            many = _particles.looked_at(air, view.slopes(), parameters.shutter_ms * 1e-3)
            assert many <= _particles.MOST_LOOKED_AT
            assert air.least_rad >= parameters.least_mrad * 1e-3


@cases("name", MODULES)
@cases("degrees", [170, 178.5, 179.999])
def test_a_very_wide_view_is_veiled(name, degrees, monkeypatch):
    """By the law of Koschmieder with all particles, but for those few that are drawn."""
    monkeypatch.setattr(_particles, "MOST_LOOKED_AT", 100_000)
    monkeypatch.setattr(_particles, "MOST_CUBES", 5_000)
    drawn_air.cache_clear()
    depth_m, rgb = np.full((120, 160), 5.0, np.float32), np.zeros((120, 160, 3), np.uint8)
    values = {"air": "colour", "air_red": 1.0, "air_green": 1.0, "air_blue": 1.0, "reach_m": 5.0}
    found = apply(rgb, name, 5, depth_m=depth_m, intrinsics=camera(degrees), stamp_s=0.0, **values)
    drawn_air.cache_clear()
    encoded = found.mean() / 255
    linear = encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4
    sigma = MODULES[name].KIND.particles(MODULES[name].PERTURBATION.at_severity(5).rate_mm_h).extinction_per_m
    most = 1 - math.exp(-5 * sigma)  # half of it is diffraction, which what is drawn does not have
    assert 0.4 * most < linear < 1.05 * most


def test_a_plan_says_what_it_does_not_draw(tmp_path):
    steps = [[{"snow_depth": {"severity": 5}}], [{"rain_depth": {"severity": 0}}], []]
    chosen = [{"name": f"s{number}", "perturb": each} for number, each in enumerate(steps)]
    for focal_px, said in ((50.0, 0), (0.5, 1)):
        wide = {"width": 160, "height": 120, "fx": focal_px, "fy": focal_px, "cx": 79.5, "cy": 59.5}
        preset = write_world(tmp_path / str(focal_px), frames=1, settings=chosen, camera=wide)
        notes = [text for text in plan_notes(make_plan(read_preset(preset))) if "least_mrad" in text]
        assert len(notes) == said
        assert all(text.startswith("s0: snow_depth") for text in notes)
