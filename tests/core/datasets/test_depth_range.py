# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth beyond 16 bits: counted against plain loops, and the scale that holds it against trying every one."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest

from noisy_world.core.depth_range import DepthRange, OutOfRange, RangeLoss, range_loss, scale_that_holds
from noisy_world.images.pixels import out_of_range, quantise_depth
from noisy_world.core.frame_table import FrameRecord, joined_records, read_records

INF = math.inf


def counted(depth_m, scale_per_m):
    """The same by hand, in exact arithmetic: pixels with depth, those whose nearest step is above 65535, farthest."""
    with_depth = [float(value) for value in depth_m.ravel() if value > 0]
    finite = [value for value in with_depth if value < INF]
    lost = [value for value in finite if Fraction(value) * Fraction(scale_per_m) >= Fraction(131071, 2)]
    infinite = len(with_depth) - len(finite)
    return len(lost) + infinite, len(with_depth), max(lost, default=None), infinite


@pytest.mark.parametrize("scale_per_m", [6553.5, 5000.0, 1000.0, 20000.0, 0.5])
def test_what_is_lost_is_counted_as_by_hand(scale_per_m):
    limit = np.float32(65535 / scale_per_m)
    rng = np.random.default_rng(3)
    depth = (rng.uniform(0, 2, (40, 50)) * limit).astype(np.float32)
    edges = [limit, np.nextafter(limit, np.float32(INF)), np.float32(65535.5 / scale_per_m), 65535.49 / scale_per_m]
    depth[0, : len(edges)] = edges
    depth[1, :6] = [0, -1, np.nan, INF, -INF, 1e30]
    found = out_of_range(depth, scale_per_m)
    assert (found.pixels, found.of, found.farthest_m, found.infinite) == counted(depth, scale_per_m)
    # What is counted is exactly what the encoder drops: it was depth, and is void.
    far = depth > 0.5 * limit
    assert found.pixels == np.count_nonzero(far & (quantise_depth(depth, scale_per_m) == 0))


def test_nothing_is_said_where_all_is_held():
    for depth in ([[0, 1, 10]], [[np.nan, 1]], [[-INF, 10]], [[0]], np.zeros((0, 3))):
        assert out_of_range(np.array(depth, np.float32), 6553.5) is None
    assert out_of_range(np.array([[np.nan, 10.1]], np.float32), 6553.5).pixels == 1
    assert out_of_range(np.array([[INF]], np.float32), 6553.5) == OutOfRange(1, 1, None, 1)


def test_the_scale_that_holds_is_the_largest_round_one():
    series = [step * 10.0**power for power in range(-6, 7) for step in (1, 2, 5)]
    rng = np.random.default_rng(4)
    for farthest_m in [
        10.001,
        13.107,
        13.1071,
        32.7675,
        44.7,
        65.535,
        65.536,
        6553.5,
        1e5,
        *10 ** rng.uniform(-1, 6, 500),
    ]:
        scale_per_m = scale_that_holds(farthest_m)
        assert scale_per_m == pytest.approx(max(step for step in series if round(farthest_m * step) <= 65535))
        assert out_of_range(np.array([[farthest_m]]), scale_per_m) is None
        assert quantise_depth(np.array([[farthest_m]]), scale_per_m)[0, 0] > 0


def test_what_a_record_tells_is_read_back(tmp_path):
    for lost in (OutOfRange(3, 48, 44.72135925292969), OutOfRange(3, 48, 12.5, 1), OutOfRange(2, 48, None, 2)):
        colour = FrameRecord(4, 0.2, {"results/frame000004.jpg": "a"})
        depth = FrameRecord(4, 0.2, {"results/depth000004.png": "b"}, out_of_range=lost)
        for order in ((colour, depth), (depth, colour)):
            (tmp_path / "journal").write_text("".join(record.line() for record in order))
            (found,) = joined_records(read_records(tmp_path / "journal")).values()
            assert found.out_of_range == lost
            assert set(json.loads(found.line(), parse_constant=pytest.fail)["depth_out_of_range"]) >= {"pixels", "of"}
    assert "depth_out_of_range" not in colour.line()


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"pixels": 0, "of": 1},
        {"pixels": 2, "of": 1},
        {"pixels": 1, "of": 1, "farthest_m": INF},
        [],
        {"pixels": "x"},
    ],
)
def test_a_line_with_impossible_counts_is_no_record(tmp_path, content):
    line = {"frame": 0, "time_s": 0.0, "sha256": {"depth/000000.png": "a"}, "depth_out_of_range": content}
    (tmp_path / "frames.jsonl").write_text(json.dumps(line) + "\n")
    assert list(read_records(tmp_path / "frames.jsonl")) == []


def test_a_sequence_is_summed_up():
    images = [OutOfRange(10, 40, 12.0), None, OutOfRange(30, 48, 44.5), OutOfRange(8, 48, None, 8)]
    assert range_loss(images, 48) == RangeLoss(48 / 192, 3, 44.5, 8)
    assert range_loss([None, None], 48) is None


# --- in words ---


def test_one_image_in_words():
    lost = OutOfRange(1200, 2000, 44.7213)
    void, farthest = DepthRange(6553.5, "void"), DepthRange(6553.5, "farthest")
    assert (
        void.format_image_loss(lost, 10000) == "12 % of its pixels lie beyond 10 m, as far as 44.73 m, and become void"
    )
    assert farthest.format_image_loss(lost, 10000).endswith("and become 10 m")
    assert "beyond 13.1 m, infinitely far" in DepthRange(5000, "void").format_image_loss(OutOfRange(1, 5, None, 1), 5)
    assert "as far as 14 m, some infinitely far, and" in DepthRange(5000, "void").format_image_loss(
        OutOfRange(2, 5, 14.0, 1), 5
    )
    assert "beyond 10 m, as far as 10.01 m" in void.format_image_loss(OutOfRange(1, 5, 10.0003), 5)
    assert void.format_image_loss(OutOfRange(1, 5, 12.0), 10**6).startswith("less than 0.001 %")


@pytest.mark.parametrize(
    ("beyond", "farthest_m", "words"),
    [
        (
            "void",
            44.7,
            "output.depth_scale_per_m: 1000 holds 65.5 m in steps of 1 mm, or output.depth_beyond: farthest",
        ),
        ("void", 12.0, "output.depth_scale_per_m: 5000 holds 13.1 m in steps of 0.2 mm, or output.depth_beyond"),
        ("farthest", 44.7, "output.depth_scale_per_m: 1000 holds 65.5 m in steps of 1 mm"),
        ("void", None, "output.depth_beyond: farthest makes them 10 m"),
        ("void", 1e6, "output.depth_beyond: farthest makes them 10 m"),  # a step would be 20 m
        ("farthest", None, ""),
    ],
)
def test_the_remedy_names_keys_and_values_that_do(beyond, farthest_m, words):
    told = DepthRange(6553.5, beyond).with_remedy("told", farthest_m)
    assert told == "told" if not words else told.startswith(f"told; {words}")
    assert ("depth_beyond" in told) == (beyond == "void")


def test_a_scene_is_told_by_its_worst_setting():
    losses = {
        "clean": RangeLoss(0.25, 3, 40.0, 0),
        "noisy": RangeLoss(0.31, 4, 66.0, 0),
        "late": RangeLoss(0.2, 2, 39.0, 0),
    }
    told = DepthRange(6553.5, "void").format_scene_loss(losses, {"clean": 4, "noisy": 5, "late": 4})
    assert told.startswith(
        "31 % of the pixels of noisy (in 4 of 5 frames, the most of 3 settings) lie beyond 10 m, as far as 66 m, and "
        "became void; output.depth_scale_per_m: 500 holds 131 m in steps of 2 mm"
    )
    losses["late"] = RangeLoss(0.2, 2, 67.0, 0)
    told = DepthRange(6553.5, "void").format_scene_loss(losses, {"clean": 4, "noisy": 5, "late": 4})
    assert (
        "(in 4 of 5 frames, the most of 3 settings, of which one reaches 67 m) lie beyond 10 m, as far as 66 m" in told
    )
    told = DepthRange(6553.5, "void").format_scene_loss({"clean": RangeLoss(1.0, 2, None, 9)}, {"clean": 2})
    assert told.startswith(
        "100 % of the pixels of clean (in 2 of 2 frames) lie beyond 10 m, infinitely far, and became"
    )
