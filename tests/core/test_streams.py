# SPDX-License-Identifier: GPL-3.0-or-later
import hashlib
import itertools

import numpy as np
from refusals import refused
from cases import cases

from noisy_world.core.streams import integers_of_frames, stream

MASK = 2**64 - 1


def philox_block(counter, key):
    """Philox4x64-10 after Salmon et al. 2011 on Python's whole numbers: one block of four 64-bit words."""
    c0, c1, c2, c3 = counter
    k0, k1 = key
    for _ in range(10):
        p0, p1 = 0xD2E7470EE14C6C93 * c0, 0xCA5A826395121157 * c2
        c0, c1, c2, c3 = (p1 >> 64) ^ c1 ^ k0, p1 & MASK, (p0 >> 64) ^ c3 ^ k1, p0 & MASK
        k0, k1 = (k0 + 0x9E3779B97F4A7C15) & MASK, (k1 + 0xBB67AE8584CAA73B) & MASK
    return [c0, c1, c2, c3]


def raw(*identifiers, frame=0, count=16):
    return stream(*identifiers, frame=frame).bit_generator.random_raw(count)


def words(text):
    return [int(word, 16) for word in text.split()]


@cases(
    ("counter", "key", "block"),
    [
        ("0 0 0 0", "0 0", "16554d9eca36314c db20fe9d672d0fdc d7e772cee186176b 7e68b68aec7ba23b"),
        (
            "243f6a8885a308d3 13198a2e03707344 a4093822299f31d0 082efa98ec4e6c89",
            "452821e638d01377 be5466cf34e90c6c",
            "a528f45403e61d95 38c72dbd566e9788 a5a1610e72fd18b5 57bd43b5e52b7fe6",
        ),
    ],
)
def test_philox_of_this_file_gives_the_published_answers(counter, key, block):
    # Random123's kat_vectors, philox4x64 10.
    assert philox_block(words(counter), words(key)) == words(block)


@cases("frame", [0, 1, 1999, 2**64 - 1])
def test_numbers_are_philox_with_the_frame_in_the_highest_word(frame):
    digest = hashlib.sha256(b'["seed",7,"room0","fog"]').digest()
    key = [int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")]
    # numpy counts before it draws: the first block is 1.
    expected = [word for block in range(1, 4) for word in philox_block([block, 0, 0, frame], key)]
    assert raw("seed", 7, "room0", "fog", frame=frame, count=12).tolist() == expected


def test_same_identifiers_same_numbers_in_any_order_of_frames():
    forth = [stream("a", 1, frame=k).normal(size=100) for k in range(20)]
    back = [stream("a", 1, frame=k).normal(size=100) for k in reversed(range(20))]
    np.testing.assert_array_equal(forth, back[::-1])


def test_identifiers_are_told_apart():
    different = [
        ("ab", "c"), ("a", "bc"), ("abc",), ("a", "b", "c"), ("", "abc"), ("abc", ""),
        (1,), ("1",), (1, 2), (12,), (2, 1), (-1,), (10**30,), ('a","b',), ("a", "b"), ("a,b",),
        ("é",), ("e\u0301",), ("\\u00e9",), ("true",), ("\ud800",),
    ]  # fmt: skip
    drawn = {tuple(raw(*identifiers, count=2).tolist()) for identifiers in different}
    assert len(drawn) == len(different)


def test_nearby_streams_are_uncorrelated():
    names = [("fog", 0), ("fog", 1), ("fog", 2), ("snow", 0), ("snow", 1)]
    drawn = [stream(*name).normal(size=50_000) for name in names]
    for a, b in itertools.combinations(drawn, 2):
        assert abs(np.corrcoef(a, b)[0, 1]) < 5 / np.sqrt(50_000)


def test_frames_are_uncorrelated_over_lags():
    count = 20_000
    frames = np.array([stream("noise", frame=k).normal(size=count) for k in range(4)])
    bound = 5.5 / np.sqrt(count)  # of some 770 correlations none comes near by chance
    for a, b in itertools.combinations(frames, 2):
        for lag in range(65):
            assert abs(np.mean(a[lag:] * b[: count - lag])) < bound
            assert abs(np.mean(b[lag:] * a[: count - lag])) < bound


def test_no_frame_is_another_one_shifted():
    frames = [raw("noise", frame=k, count=1024) for k in range(6)]
    assert len(set(np.concatenate(frames).tolist())) == 6 * 1024
    # The same with the frame in the lowest word: each frame repeats the one before, four values later.
    key = np.array([1, 2], dtype=np.uint64)
    low = [np.random.Philox(key=key, counter=np.array([k, 0, 0, 0], dtype=np.uint64)).random_raw(64) for k in (0, 1)]
    np.testing.assert_array_equal(low[0][4:], low[1][:-4])


@cases("frame", [-1, 2**64])
def test_frames_out_of_range(frame):
    refused(stream, "a", frame=frame, names="2^64", error=ValueError)


def test_numpy_frames_are_frames():
    np.testing.assert_array_equal(raw("a", frame=np.int64(5)), raw("a", frame=5))


@cases("identifiers", [(1.0,), (True,), (None,), (b"a",), ("a", ("b",)), (np.int64(1),)])
def test_identifiers_of_other_types(identifiers):
    refused(stream, *identifiers, names="whole numbers", error=TypeError)


def test_frames_of_other_types():
    for frame in (1.0, True, "1"):
        refused(stream, "a", frame=frame, names="frame", error=TypeError)


def test_no_identifier():
    refused(stream, names="at least one", error=ValueError)


@cases(("low", "high"), [(-1, 2), (0, 5), (3, 4), (-7, 2**31), (0, 2**32 - 1)])
def test_numbers_of_all_frames_at_once_are_those_of_each(low, high):
    # With nearly 2^32 choices numpy draws about half of them again.
    names = ("seed", 7, "room0", "desync", high)
    single = [stream(*names, frame=k).integers(low, high) for k in range(300)]
    np.testing.assert_array_equal(integers_of_frames(*names, count=300, low=low, high=high), single)
    assert integers_of_frames(*names, count=0, low=low, high=high).shape == (0,)
