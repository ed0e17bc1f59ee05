# SPDX-License-Identifier: GPL-3.0-or-later
"""The arrays and numbers that the library is given: used as they are meant, or refused with the argument's name."""

import warnings
from itertools import cycle

from cases import cases
import numpy as np
from refusals import refused

from noisy_world.core.errors import InputError
from noisy_world.core.geometry import Intrinsics
from noisy_world.perturbations.kinds import SEQUENCE_KINDS, ColourPerturbation, DepthPerturbation
from noisy_world.perturb import apply, frames
from noisy_world.perturbations import registry

RNG = np.random.default_rng(7)
BYTES = RNG.integers(0, 256, (9, 14, 3), dtype=np.uint8)
FLOATS = RNG.random((9, 14, 3), dtype=np.float32)
DEPTH = RNG.uniform(0.2, 6, (9, 14)).astype(np.float32)
CAMERA = Intrinsics(14, 9, 20.0, 20.0, 6.5, 4.0)


def changed(array, value, at=(0, 0)):
    array = array.copy()
    array[at] = value
    return array


@cases(
    ("image", "name", "kind", "words"),
    [
        (FLOATS[0, :, 0], "fog", TypeError, "image has the shape (14,)"),
        (np.dstack([BYTES, BYTES[..., :1]]), "fog", TypeError, "alpha channel"),
        (BYTES[..., :2], "fog", TypeError, "(H, W, 3)"),
        (BYTES[:0], "fog", ValueError, "image has the shape (0, 14, 3), which has no pixels"),
        (BYTES[:, :0], "fog", ValueError, "no pixels"),
        (BYTES.tolist(), "fog", TypeError, "image is a list, but has to be a numpy array"),
        (None, "fog", TypeError, "image is None, as cv2.imread gives where there is no image"),
        (BYTES.astype(object), "fog", TypeError, "image is object"),
        (BYTES > 9, "fog", TypeError, "image is bool"),
        (BYTES.astype(np.int64), "fog", TypeError, "image is int64"),
        (BYTES.astype(np.uint16), "fog", TypeError, "image is uint16"),
        (BYTES.astype(np.complex64), "fog", TypeError, "image is complex64"),
        (BYTES.astype(np.float64), "fog", ValueError, "divide it by 255"),
        (changed(FLOATS, 1.001), "fog", ValueError, "image holds 1.00100005, but float colour is in [0, 1]"),
        (changed(FLOATS, -0.5), "fog", ValueError, "image holds -0.5"),
        (changed(FLOATS, np.nan, (3, 5)), "fog", ValueError, "image holds nan at row 3, column 5"),
        (changed(FLOATS, np.inf), "fog", ValueError, "image holds inf"),
        (np.ma.masked_array(FLOATS, FLOATS > 2), "fog", TypeError, "masked array"),
        (BYTES, "depth_random_missing", TypeError, "depth has to be (H, W)"),
        (DEPTH.astype(np.uint16), "depth_random_missing", TypeError, "image is uint16, but depth has to be float32"),
        (DEPTH > 2, "depth_random_missing", TypeError, "image is bool"),
        (DEPTH.astype(object), "depth_random_missing", TypeError, "image is object"),
        (changed(DEPTH, -1), "depth_random_missing", ValueError, "image holds -1 m"),
        (changed(DEPTH, np.nan), "depth_random_missing", ValueError, "nan at row 0, column 0; write 0 where"),
        (changed(DEPTH.astype(np.float64), 1e300), "depth_random_missing", ValueError, "image holds 1e+300"),
        (DEPTH[:0], "depth_random_missing", ValueError, "no pixels"),
    ],
)
def test_images_that_are_refused(image, name, kind, words):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refused(apply, image, name, severity=3, names=words, error=kind)


@cases(
    ("given", "kind", "words"),
    [
        ({"seed": -1}, ValueError, "seed is the number -1, but has to be from 0"),
        ({"seed": 2**63}, ValueError, "seed"),
        ({"seed": 10**5000}, ValueError, "seed"),
        ({"seed": 1.0}, TypeError, "seed is the number 1.0, but has to be a whole number"),
        ({"seed": True}, TypeError, "seed is the truth value true"),
        ({"seed": "7"}, TypeError, "seed is the text '7'"),
        ({"seed": None}, TypeError, "seed is empty"),
        ({"frame": -1}, ValueError, "frame"),
        ({"frame": 2**64}, ValueError, "frame"),
        ({"frame": "0"}, TypeError, "frame is the text '0'"),
        ({"severity": "3"}, InputError, "severity"),
        ({"severity": np.nan}, InputError, "severity"),
        ({"severity": [3]}, InputError, "severity"),
        ({"levels": b"\1", "mode": "dynamic"}, InputError, "levels"),
        ({"stamp_s": "now"}, TypeError, "stamp_s"),
        ({"stamp_s": np.inf}, ValueError, "stamp_s"),
        ({"stamp_s": 10**400}, ValueError, "stamp_s"),
        ({"intrinsics": (1, 2, 3)}, TypeError, "intrinsics is a tuple"),
        ({"intrinsics": Intrinsics(14, 8, 9.0, 9.0, 6.5, 4.0)}, ValueError, "intrinsics is of 14 x 8 pixels"),
        ({"depth_m": DEPTH[:5]}, ValueError, "depth_m is 14 x 5 pixels, but the image is 14 x 9"),
        ({"depth_m": DEPTH.astype(np.int64)}, TypeError, "depth_m is int64"),
        ({"depth_m": -DEPTH}, ValueError, "depth_m holds -"),
        ({"rgb": FLOATS * 300}, ValueError, "rgb holds"),
        ({"rgb": DEPTH[0]}, TypeError, "rgb has the shape (14,)"),
    ],
)
def test_numbers_and_other_images_that_are_refused(given, kind, words):
    refused(apply, FLOATS, "fog", **given, names=words, error=kind)


@cases("name", [3, None, ["fog"], b"fog", {"fog": 1}])
def test_a_name_is_a_text(name):
    refused(apply, BYTES, name, severity=3, names="name is ", error=TypeError)


def test_a_name_that_is_no_perturbation():
    refused(apply, BYTES, "x" * 100_000, names="perturbation")


def variants(array):
    """The same values in other memory: read-only, reversed and doubled strides, Fortran order, the other byte order."""
    read_only = array.copy()
    read_only.setflags(write=False)
    doubled = np.repeat(np.repeat(array, 2, axis=0), 2, axis=1)[::2, ::2]
    swapped = array.astype(array.dtype.newbyteorder("S"))
    return {
        "read-only": read_only,
        "strided": doubled,
        "reversed": np.ascontiguousarray(array[:, ::-1])[:, ::-1],
        "fortran": np.asfortranarray(array),
        "swapped": swapped,
        "float64": array.astype(np.float64) if array.dtype.kind == "f" else array,
        "longdouble": array.astype(np.longdouble) if array.dtype.kind == "f" else array,
    }


@cases("name", [name for name, item in registry().items() if not isinstance(item, SEQUENCE_KINDS)])
def test_the_same_values_in_other_memory_give_the_same_pixels(name):
    kind = registry()[name]
    images = [DEPTH] if isinstance(kind, DepthPerturbation) else [BYTES, FLOATS]
    seen = {"depth_m": DEPTH} if isinstance(kind, ColourPerturbation) and kind.needs_depth else {}
    if isinstance(kind, DepthPerturbation):
        seen |= {"intrinsics": CAMERA} | ({"rgb": BYTES} if kind.needs_rgb else {})
    for image in images:
        expected = apply(image, name, severity=3, seed=3, frame=4, **seen)
        severities = cycle((3, np.int64(3), np.float32(3)))
        for (told, variant), severity in zip(variants(image).items(), severities, strict=False):
            before = variant.copy()
            found = apply(variant, name, severity=severity, seed=np.uint8(3), frame=np.int32(4), **seen)
            assert found.dtype == image.dtype, told
            assert np.array_equal(found, expected), told
            assert np.array_equal(variant, before)
            assert not np.shares_memory(found, variant)
            idle = apply(variant, name, severity=0, **seen)
            assert np.array_equal(idle, image)
            assert not np.shares_memory(idle, variant)


@cases("name", [name for name, item in registry().items() if not isinstance(item, SEQUENCE_KINDS)])
@cases("shape", [(1, 1), (1, 30), (30, 1)])
def test_images_of_few_pixels(name, shape):
    depth_m = np.resize(DEPTH, shape)
    of_depth = isinstance(registry()[name], DepthPerturbation)
    for image in [depth_m] if of_depth else [np.resize(BYTES, (*shape, 3)), np.resize(FLOATS, (*shape, 3))]:
        seen = {"rgb": np.resize(BYTES, (*shape, 3))} if of_depth else {"depth_m": depth_m}
        seen["intrinsics"] = Intrinsics(*shape[::-1], 20.0, 20.0, (shape[1] - 1) / 2, (shape[0] - 1) / 2)
        found = apply(image, name, severity=5, **seen)
        assert (found.shape, found.dtype) == (image.shape, image.dtype)
        assert np.isfinite(found).all()


def test_rounding_is_clipped_and_half_floats_are_colours():
    over = changed(FLOATS, 1 + 5e-7)
    assert np.array_equal(apply(over, "contrast", severity=0), changed(FLOATS, 1))
    half = FLOATS.astype(np.float16)
    assert np.array_equal(apply(half, "contrast", severity=2), apply(half.astype(np.float32), "contrast", severity=2))


def test_frames_refuses_when_it_is_called(tmp_path):
    for given, names in (
        ({"seed": -1}, "seed"),
        ({"setting": 3}, "setting is the number 3"),
        ({"scene": 3}, "scene is the number 3"),
        ({"rate_hz": 0}, "rate_hz is the number 0,"),
        ({"rate_hz": "20"}, "rate_hz is the text '20'"),
        ({"rate_hz": np.nan}, "rate_hz is the number nan"),
        ({"intrinsics": (1, 2)}, "intrinsics is a tuple"),
    ):
        refused(frames, tmp_path, [], **given, names=names, error=(TypeError, ValueError))
    for perturb in ("fog", {"fog": None}, None):
        refused(frames, tmp_path, perturb, names="perturb is", error=TypeError)
    refused(frames, tmp_path, [], names=str(tmp_path))
