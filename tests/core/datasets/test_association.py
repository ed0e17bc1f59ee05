# SPDX-License-Identifier: GPL-3.0-or-later
"""Which colour, depth and pose belong together, against the published description of associate.py, line by line."""

from fractions import Fraction

import numpy as np
import pytest
from refusals import refused
from cases import cases

from noisy_world.layouts.stored_recording import associate, associate_frames, StampedFiles
from noisy_world.layouts import LAYOUTS, find_sequence
from noisy_world.layouts.layout import OutputFormat
from noisy_world.core.trajectory import Stamps
from noisy_world.core.trajectory import Trajectory, evenly_stamped
from noisy_world.testing.dataset_contracts import write_sequence


def as_published(first, second, within):
    """The benchmark's description of its script, in the words of Python.

    Every pair of stamps whose difference is below the limit is a candidate; candidates are sorted by difference, then
    by the first stamp, then by the second; in this order each is a match if neither of its stamps has been used.
    """
    candidates = []
    for a in first:
        candidates += [(abs(a - b), a, b) for b in second if abs(a - b) < within]
    candidates.sort()
    free_first, free_second, matches = set(first), set(second), []
    for _, a, b in candidates:
        if a in free_first and b in free_second:
            free_first.remove(a)
            free_second.remove(b)
            matches.append((a, b))
    return sorted(matches)


def jittered(rng, *, count, rate_hz, jitter_s, drop, start_s, decimals=6):
    """Stamps of a camera that is not on time and loses images."""
    stamps_s = start_s + np.arange(count) / rate_hz + rng.uniform(-jitter_s, jitter_s, count)
    return np.unique(np.round(stamps_s[rng.random(count) >= drop], decimals))


@cases("seed", range(40))
def test_association_is_the_published_one(seed):
    rng = np.random.default_rng(seed)
    start_s = float(rng.choice([0.0, 100.0, 1305031102.175304, 1.4e9]))
    decimals = int(rng.choice([2, 3, 6]))  # of two decimals there are many ties
    made = [
        jittered(
            rng,
            count=int(rng.integers(5, 120)),
            rate_hz=float(rng.choice([15, 30, 60, 200])),
            jitter_s=float(rng.choice([0.0, 0.004, 0.015, 0.03])),
            drop=float(rng.choice([0.0, 0.1, 0.5])),
            start_s=start_s + rng.uniform(0, 0.02),
            decimals=decimals,
        )
        for _ in range(2)
    ]
    first, second = made
    rows, partners = associate(first, second)
    found = list(zip(first[rows].tolist(), second[partners].tolist(), strict=True))
    assert found == as_published(first.tolist(), second.tolist(), 0.02)
    assert len(set(partners.tolist())) == len(partners)


def test_equal_depth_candidates_and_ties():
    # A depth in the middle of two colours, and a colour in the middle of two depths: exact in binary, so real ties.
    assert [list(map(int, side)) for side in associate(np.array([0.0, 0.015625]), np.array([0.0078125]))] == [[0], [0]]
    assert [list(map(int, side)) for side in associate(np.array([0.0078125]), np.array([0.0, 0.015625]))] == [[0], [0]]
    # The nearest takes the depth, though an earlier image is within the limit; that one takes the next best, which
    # crosses, or none where a third image is nearer to that.
    for first, wanted in (([0.0, 0.010], [(0, 1), (1, 0)]), ([0.0, 0.010, 0.030], [(1, 0), (2, 1)])):
        rows, partners = associate(np.array(first), np.array([0.009, 0.019, 0.045]))
        assert list(zip(rows.tolist(), partners.tolist(), strict=True)) == wanted


def test_the_limit_itself_is_too_far():
    limit = 0.02
    below = float(np.nextafter(limit, 0))
    assert associate(np.array([0.0]), np.array([limit]))[0].size == 0
    assert associate(np.array([0.0]), np.array([below]))[0].size == 1
    # At a real clock the difference is what float64 makes of it, as in the script.
    for start in (1305031102.175304, 1.4e9, 4e9):
        for step in range(-3, 4):
            b = start + limit
            for _ in range(abs(step)):
                b = float(np.nextafter(b, np.inf if step > 0 else -np.inf))
            expected = len(as_published([start], [b], limit))
            assert associate(np.array([start]), np.array([b]))[0].size == expected
            assert (abs(Fraction(b) - Fraction(start)) < Fraction(limit)) == bool(expected)  # the difference is exact


def test_stamps_in_another_unit_are_one_line_and_no_memory(tmp_path):
    stamps = Stamps(np.arange(20_000) * 1e-9)
    files = tuple(tmp_path / f"{k}.png" for k in range(20_000))
    path = Trajectory(np.stack([np.eye(4)] * 2), np.array([0.0, 1.0]))
    listed = StampedFiles(stamps, files)
    named = (str(tmp_path), "400000000 pairs", "0.02 s", "another unit")
    refused(associate_frames, tmp_path, listed, listed, path, names=named)


def listed(folder, name, stamps_s):
    return StampedFiles(Stamps(np.asarray(stamps_s)), tuple(folder / f"{name}{k}.png" for k in range(len(stamps_s))))


def path_at(stamps_s):
    poses = np.stack([np.eye(4)] * len(stamps_s))
    poses[:, 0, 3] = np.arange(len(stamps_s))
    return Trajectory(poses, np.asarray(stamps_s))


@cases("seed", range(10))
def test_frames_are_associated_in_two_steps_as_with_the_script(tmp_path, seed):
    rng = np.random.default_rng(seed)
    rgb, depth, poses = (
        jittered(rng, count=80, rate_hz=rate, jitter_s=0.006, drop=0.15, start_s=1.4e9 + shift)
        for rate, shift in ((30, 0.0), (30, 0.007), (float(rng.choice([20, 100])), 0.003))
    )
    with_depth = as_published(rgb.tolist(), depth.tolist(), 0.02)
    of_depth = dict(with_depth)
    wanted = as_published(list(of_depth), poses.tolist(), 0.02)
    found = associate_frames(tmp_path, listed(tmp_path, "c", rgb), listed(tmp_path, "d", depth), path_at(poses))
    assert found.stamps.rgb.seconds.tolist() == [a for a, _ in wanted] == found.trajectory.stamps_s.tolist()
    assert found.stamps.depth.seconds.tolist() == [of_depth[a] for a, _ in wanted]
    assert found.stamps.pose.seconds.tolist() == [b for _, b in wanted]
    assert [file.name for file in found.rgb_files] == [f"c{rgb.tolist().index(a)}.png" for a, _ in wanted]
    assert [file.name for file in found.depth_files] == [f"d{depth.tolist().index(of_depth[a])}.png" for a, _ in wanted]
    assert found.trajectory.c2w[:, 0, 3].tolist() == [poses.tolist().index(b) for _, b in wanted]
    lost, no_depth = len(rgb) - len(wanted), len(rgb) - len(with_depth)
    assert found.notes[0].startswith(f"{lost} of {len(rgb)} colour images are left out: ")
    assert (f"{no_depth} with no depth image" in "".join(found.notes)) == bool(no_depth)
    assert (f"{lost - no_depth} with no pose" in "".join(found.notes)) == bool(lost - no_depth)


def test_poses_that_cross_stay_with_their_images(tmp_path):
    found = associate_frames(
        tmp_path,
        listed(tmp_path, "c", [0.010, 0.022]),
        listed(tmp_path, "d", [0.010, 0.022]),
        path_at([0.004, 0.011]),
    )
    assert found.stamps.pose.seconds.tolist() == [0.011, 0.004]
    assert found.trajectory.c2w[:, 0, 3].tolist() == [1, 0]
    assert found.notes == ()


def test_a_frame_that_is_kept_without_a_pose_moves_no_other_pose(tmp_path):
    colour, depth = (listed(tmp_path, name, [0.0, 1.0, 2.0]) for name in "cd")
    found = associate_frames(tmp_path, colour, depth, path_at([-5.0, 1.0, 2.0]), policy="keep")
    assert found.trajectory.known.tolist() == [False, True, True]
    assert found.trajectory.c2w[1:, 0, 3].tolist() == [1, 2]


def test_no_common_time_says_what_each_list_covers(tmp_path):
    colour, depth = (listed(tmp_path, name, [0.0, 1.0]) for name in "cd")
    named = ("within 0.02 s", "pose 50.000000 to 51.500000 s")
    refused(associate_frames, tmp_path, colour, depth, path_at([50.0, 51.5]), names=named)


@pytest.mark.parametrize(
    ("layout_name", "truth"),
    [
        ("tum", "groundtruth.txt"),
        ("euroc", "mav0/state_groundtruth_estimate0/data.csv"),
        ("vslamlab", "groundtruth.csv"),
    ],
)
def test_a_recording_whose_truth_has_a_stamp_twice(tmp_path, layout_name, truth):
    layout = LAYOUTS[layout_name]
    written = OutputFormat(layout, layout.images[0], layout.colours[0], ("rgb", "depth"), layout.depth_scale_per_m)
    write_sequence(written, evenly_stamped(np.tile(np.eye(4), (5, 1, 1))), tmp_path / "scene")
    once = find_sequence(tmp_path / "scene")
    lines = (tmp_path / "scene" / truth).read_text().splitlines(keepends=True)
    (tmp_path / "scene" / truth).write_text("".join([*lines[:-2], lines[-2], lines[-2], lines[-1]]))
    twice = find_sequence(tmp_path / "scene")
    assert twice.stamps.pose.ns == once.stamps.pose.ns
    np.testing.assert_array_equal(twice.trajectory.c2w, once.trajectory.c2w)
    assert any("has the time stamp of the pose before" in note for note in twice.notes)
