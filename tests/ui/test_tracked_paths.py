# SPDX-License-Identifier: GPL-3.0-or-later
"""How a tracked path is cut into pieces, and what is said of it; without Blender."""

import numpy as np
import pytest

from noisy_world.panel.drawn_paths import estimated_pieces, length, true_pieces

LINE = np.stack([np.arange(7.0), np.zeros(7), np.zeros(7)], axis=-1)
NAN = np.nan


def along(pieces):
    """The x of each piece's positions."""
    return {part: [piece[:, 0].tolist() for piece in found] for part, found in pieces.items()}


def test_an_estimate_has_gaps_where_it_was_lost_and_changes_colour_with_its_error():
    error_m = np.array([0.001, 0.002, 0.03, NAN, NAN, 0.2, 0.2])
    assert along(estimated_pieces(LINE, error_m)) == {
        "near": [[0.0, 1.0]],
        "off": [[1.0, 2.0]],
        "far": [[5.0, 6.0]],
    }


def test_a_frame_between_lost_ones_is_a_piece_of_its_own():
    error_m = np.array([NAN, 0.0, NAN, 0.02, NAN, NAN, 0.06])
    assert along(estimated_pieces(LINE, error_m)) == {"near": [[1.0]], "off": [[3.0]], "far": [[6.0]]}


def test_a_run_that_failed_has_no_estimate():
    assert estimated_pieces(LINE, np.full(7, NAN)) == {}


def test_the_true_path_shows_where_the_camera_was_lost():
    tracked = np.array([True, True, False, True, True, True, False])
    assert along(true_pieces(LINE, tracked)) == {
        "true": [[0.0, 1.0], [3.0, 4.0, 5.0]],
        "lost": [[1.0, 2.0, 3.0], [5.0, 6.0]],
    }
    assert along(true_pieces(LINE[:1], np.array([False]))) == {"lost": [[0.0]]}


@pytest.mark.parametrize(
    ("metres", "told"),
    [(0.0, "0 mm"), (0.00042, "0.42 mm"), (0.0034, "3.4 mm"), (0.0123, "1.23 cm"), (0.5, "50 cm"), (2.0, "2 m")],
)
def test_lengths_in_the_unit_that_fits(metres, told):
    assert length(metres) == told
