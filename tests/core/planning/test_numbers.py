# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers of frames, against Python's lists; and what a plan of many long sequences holds."""

import pickle

import numpy as np
import pytest
from test_sequence import sequence

from noisy_world.dataset.sequence import ListedNumbers, array_of, numbers_of, taken, union

LISTS = [[], [4], [0, 1, 2], [3, 6, 9], [5, 5, 5], [9, 4, -1], [0, 1, 2, 2], [0, 2, 3], [7, 6, 5]]


@pytest.mark.parametrize("values", LISTS)
def test_numbers_are_as_a_list_has_them(values):
    numbers = numbers_of(np.array(values, dtype=np.int64))
    assert isinstance(numbers, range) == (values in LISTS[:4])
    assert list(numbers) == values
    assert len(numbers) == len(values)
    assert array_of(numbers).tolist() == values
    assert [numbers[k] for k in range(-len(values), len(values))] == values * 2
    assert [number in numbers for number in range(-2, 12)] == [number in values for number in range(-2, 12)]
    assert list(numbers[1:]) == values[1:]
    assert list(numbers[::2]) == values[::2]
    again = pickle.loads(pickle.dumps(numbers))
    assert again == numbers
    assert hash(again) == hash(numbers)


def test_other_numbers_are_not_equal():
    several = [numbers_of(np.array(values, dtype=np.int64)) for values in LISTS]
    for number, one in enumerate(several):
        assert [other for other, two in enumerate(several) if one == two] == [number]


def test_taking_and_uniting_are_as_lists_do_it():
    several = [numbers_of(np.array(values, dtype=np.int64)) for values in LISTS if -1 not in values]
    for numbers in several:
        for places in (range(0), range(len(numbers)), range(0, len(numbers), 2), ListedNumbers(np.array([0, 0]))):
            if len(numbers) or not len(places):
                assert list(taken(numbers, places)) == [numbers[place] for place in places]
        for other in several:
            assert list(union([numbers, other])) == sorted({*numbers, *other})


LONG = 1_000_000  # frames; as Python's own numbers, a sequence of these takes 40 MB


@pytest.mark.parametrize(
    ("perturb", "bytes_each"),
    [
        ([], 0),
        ([{"fog": {"severity": 3, "mode": "dynamic"}}, {"depth_gaussian_noise": {"severity": 2}}], 0),
        ([{"motion_deviation": {"rotation_deg": 1}}], 0),
        ([{"faster_motion": {"factor": 3}}], 0),
        ([{"desync": {"offset": 7, "edge": "drop"}}], 4),
        ([{"desync": {"offset": 7}}, {"faster_motion": {"factor": 2}}], 2),
    ],
)
def test_a_sequence_holds_no_number_for_each_frame_where_nothing_differs(perturb, bytes_each):
    laid = sequence(perturb, LONG)
    shown = [laid.sources_shown("rgb"), laid.sources_shown("depth")]
    numbers = [laid.source_frames, laid.depth_frames, laid.frames]
    assert len(pickle.dumps(numbers)) < LONG * bytes_each + 1000
    assert len(pickle.dumps([*numbers, *shown])) < 2 * LONG * bytes_each + 1000


def test_a_place_in_a_long_sequence_is_found_without_going_through_it():
    laid = sequence([{"faster_motion": {"factor": 3}}], LONG)
    assert laid.showing("depth", 999_999) == [333_333]
    assert laid.showing("depth", 999_998) == []
    assert laid.showing("rgb", LONG + 2) == []
