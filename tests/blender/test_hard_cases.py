# SPDX-License-Identifier: GPL-3.0-or-later
"""The bounds that the report's hard cases keep; the report itself gives the figures."""

import sys

from worlds import ROOT

sys.path.insert(0, str(ROOT / "headless"))

from bench import hard_cases


def column(table, number):
    return [row[number] for row in table.rows]


def test_distance_from_the_origin_costs_nothing():
    assert max(column(hard_cases.far_from_the_origin(), 1)) < 1e-5


def test_grazing_rays_err_by_less_than_a_hundredth_of_a_pixel():
    assert max(column(hard_cases.grazing_angles(), 3)) < 0.01


def test_no_ray_slips_between_triangles():
    table = hard_cases.triangle_sizes([cut for cut in hard_cases.CUTS if cut[0] != "4 mm"])
    assert max(column(table, 2)) == 0
    assert max(column(table, 1)[:2]) < 1e-6


def test_thin_structures_keep_their_share():
    for row in hard_cases.thin_structures(samples=(1, 16)).rows:
        true = row[1]
        assert row[2] == row[3]  # colour and depth are one ray
        # 37 rods at random places of 640 columns: one sample is a coin for each.
        assert abs(row[2] - true) < 4 * (37 * 0.25) ** 0.5 / 640
        assert abs(row[4] / true - 1) < 0.05


def test_coincident_faces_are_the_same_twice_and_right_in_depth():
    table = hard_cases.coincident_faces()
    assert column(table, 3) == ["yes"] * 5
    assert max(column(table, 2)) < 1e-5
    assert column(table, 1)[-1] == 1.0


def test_a_wall_is_seen_from_inside():
    rows = hard_cases.inside_a_wall().rows
    assert max(row[1] for row in rows if isinstance(row[1], float)) < 1e-5
    assert rows[2][2] == 1.0
    assert sum(isinstance(row[1], float) for row in rows) >= 3


def test_sixteen_bits_cost_half_a_step():
    for row in hard_cases.quantisation().rows:
        assert row[2] <= row[1] * (1 + 1e-9)


def test_rotations_stay_rotations():
    rows = hard_cases.composed_rotations().rows
    assert max(rows[0][1:]) < 1e-12
    assert max(rows[1][1:]) < 1e-13
    assert max(max(row[1:]) for row in hard_cases.half_turns().rows) < 1e-14
