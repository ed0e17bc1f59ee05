# SPDX-License-Identifier: GPL-3.0-or-later
"""What every perturbation of colour and depth keeps: sizes, threads, patterns, and bytes as the rounded floats."""

import warnings
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
from cases import cases

from noisy_world.core.geometry import Intrinsics
from noisy_world.images.pixels import rgb_bytes
from noisy_world.perturb import apply
from noisy_world.perturbations import registry
from noisy_world.perturbations.kinds import ColourPerturbation, DepthPerturbation

EVERY = {name: item for name, item in registry().items() if isinstance(item, ColourPerturbation | DepthPerturbation)}
TOLD = [
    name for name, item in EVERY.items() if getattr(getattr(item, "automatic", None), "looks_back_s", None) is not None
]  # by earlier frames
COLOUR = [name for name, item in EVERY.items() if isinstance(item, ColourPerturbation)]
BYTES = [name for name in COLOUR if EVERY[name].apply_bytes is not None]
DRAWN = [name for name, item in EVERY.items() if {"fresh", "fixed"} <= set(item.temporals)]
DRAWN.remove("fog_depth")  # which is even unless it is asked for clumps
STILL = [name for name, item in EVERY.items() if not item.temporals and name not in TOLD]
SIZES = [(1, 1), (1, 7), (7, 1), (3, 4), (33, 41)]


def picture(size):
    return np.random.default_rng(5).random((*size, 3), np.float32)


def room_m(size):
    """Depth from 0.5 to 4 m with void, a step and a slant."""
    down, across = np.mgrid[: size[0], : size[1]]
    depth_m = (0.5 + 3.5 * (across + 1) / size[1] * (0.7 + 0.3 * (down % 5 < 3))).astype(np.float32)
    depth_m[:: max(size[0] // 3, 2), ::5] = 0
    depth_m[-1, -1] = 2
    return depth_m


def run(name, size, image=None, frame=2, seed=1, **values):
    """A perturbed image: colour, or of perturbations of depth that."""
    camera = Intrinsics(size[1], size[0], 0.8 * size[1], 0.8 * size[1], (size[1] - 1) / 2, (size[0] - 1) / 2)
    rgb, depth_m = picture(size) if image is None else image, room_m(size)
    given = {"seed": seed, "frame": frame, "stamp_s": frame / 20, "intrinsics": camera, **values}
    if name in COLOUR:
        return apply(rgb, name, **given, **({"depth_m": depth_m} if EVERY[name].needs_depth else {}))
    return apply(depth_m, name, **given, **({"rgb": rgb} if EVERY[name].needs_rgb else {}))


@cases("name", list(EVERY))
@cases("size", SIZES)
@cases("severity", [1, 3.5, 5])
def test_any_size_without_a_warning(name, size, severity):
    for temporal in EVERY[name].temporals or (None,):
        values = {} if temporal is None else {"temporal": temporal}
        with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
            warnings.simplefilter("error")
            made = run(name, size, severity=severity, **values)
        assert made.shape == ((*size, 3) if name in COLOUR else size)
        assert made.dtype == np.float32
        assert np.isfinite(made).all()
        assert made.min() >= 0
        if name not in COLOUR and EVERY[name].order > 2:  # not a sensor, whose edges are elsewhere
            assert not made[room_m(size) == 0].any()


@cases("name", list(EVERY))
def test_threads_change_no_byte(name):
    size, threads = (90, 130), cv2.getNumThreads()
    alone = run(name, size, frame=5)
    try:
        cv2.setNumThreads(1)
        with ThreadPoolExecutor(4) as pool:
            together = list(pool.map(lambda frame: run(name, size, frame=frame), (6, 5, 4)))
    finally:
        cv2.setNumThreads(threads)
    np.testing.assert_array_equal(together[1], alone)


@cases("name", DRAWN)
def test_fresh_patterns_differ_fixed_ones_stay_and_drifting_ones_move(name):
    size = (60, 80)
    fresh = [run(name, size, frame=frame, temporal="fresh") for frame in (0, 1)]
    fixed = [run(name, size, frame=frame, temporal="fixed") for frame in (0, 1, 1234)]
    other = run(name, size, frame=0, temporal="fixed", seed=2)
    assert not np.array_equal(*fresh)
    assert not np.array_equal(fixed[0], other)
    np.testing.assert_array_equal(fixed[0], fixed[1])
    np.testing.assert_array_equal(fixed[0], fixed[2])
    if "drift" in EVERY[name].temporals:
        drift = [run(name, size, frame=frame, temporal="drift") for frame in (0, 40)]
        assert not np.array_equal(*drift)
        if name != "spatter":  # whose border is a torus' where it drifts
            np.testing.assert_array_equal(drift[0], fixed[0])


@cases("name", STILL)
def test_what_is_not_random_is_the_same_in_every_frame(name):
    if name == "flicker":  # which follows the clock
        return
    np.testing.assert_array_equal(run(name, (40, 50), frame=0), run(name, (40, 50), frame=9, seed=4))


@cases("name", BYTES)
@cases("severity", [1, 2, 3, 4, 5, 1.37])
def test_bytes_are_the_rounded_floats(name, severity):
    rgb = np.random.default_rng(1).integers(0, 256, (120, 97, 3), np.uint8)
    rgb[:9, :30] = rgb[:9, :30, :1]
    rgb[-9:] //= 200
    for image in (rgb, rgb[:, ::-1], rgb[3::2, 1::3], rgb[..., ::-1], np.asfortranarray(rgb)):
        floats = run(name, image.shape[:2], image / np.float32(255), severity=severity)
        np.testing.assert_array_equal(run(name, image.shape[:2], image, severity=severity), rgb_bytes(floats))
