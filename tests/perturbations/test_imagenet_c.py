# SPDX-License-Identifier: GPL-3.0-or-later
"""What makes ImageNet-C whole, against its published formulas; and the door of those who come from imagecorruptions."""

import colorsys
import itertools
import re

import cv2
import numpy as np
import pytest
from cases import cases
from scipy import ndimage
from worlds import ROOT

from noisy_world.perturb import apply, corrupt, get_corruption_names, names
from noisy_world.perturbations import registry
from noisy_world.perturbations.kinds import FrameContext

# As imagecorruptions 1.1.2 has them: zooms from 1 on, gain and offset of saturation, alpha of the displacement.
ZOOMS = [
    np.arange(1, last, step) for last, step in ((1.11, 0.01), (1.16, 0.01), (1.21, 0.02), (1.26, 0.02), (1.31, 0.03))
]
SATURATIONS = [(0.3, 0), (0.1, 0), (2, 0), (5, 0.1), (20, 0.2)]
ALPHAS = [250 * share for share in (0.05, 0.065, 0.085, 0.1, 0.12)]
SEVERITIES = (1, 2, 3, 4, 5)


def picture(height=90, width=130):
    rng = np.random.default_rng(3)
    soft = cv2.GaussianBlur(rng.random((height, width, 3)).astype(np.float32), (0, 0), 3)
    return (soft - soft.min()) / np.ptp(soft)


def made(name, rgb, severity=3, index=0, **given):
    item = registry()[name]
    return item.apply(rgb, item.at_severity(severity, **given), FrameContext(index, (7, "room", "setting")))


@cases("severity", SEVERITIES)
def test_severities_are_the_published_ones(severity):
    blur, colour, warp = (
        registry()[name].at_severity(severity) for name in ("zoom_blur", "saturate", "elastic_transform")
    )
    zooms = [1 + blur.step * number for number in range(blur.zooms + 1)]
    assert zooms == pytest.approx(ZOOMS[severity - 1])
    assert (colour.gain, colour.offset) == SATURATIONS[severity - 1]
    assert (warp.alpha, warp.sigma_share, warp.noise_share) == (pytest.approx(ALPHAS[severity - 1]), 0.01, 0.005)


@cases("severity", SEVERITIES)
def test_zoom_blur_is_the_mean_of_enlarged_frames(severity):
    """The frame itself once more than the zooms, of which the first is 1; each bilinear and about the middle."""
    rgb = picture()
    rows, columns = np.mgrid[: rgb.shape[0], : rgb.shape[1]].astype(np.float64)
    middle = (rgb.shape[0] - 1) / 2, (rgb.shape[1] - 1) / 2
    total = rgb.astype(np.float64)
    for zoom in ZOOMS[severity - 1]:
        places = [centre + (at - centre) / zoom for at, centre in ((rows, middle[0]), (columns, middle[1]))]
        total += np.stack([ndimage.map_coordinates(rgb[..., c].astype(float), places, order=1) for c in range(3)], -1)
    expected = total / (len(ZOOMS[severity - 1]) + 1)
    # OpenCV 4 rounds places to 1/32 pixel, OpenCV 5 does not.
    assert np.abs(made("zoom_blur", rgb, severity) - expected).max() < (2e-5 if cv2.__version__ >= "5" else 2e-3)


@cases("severity", SEVERITIES)
def test_saturate_scales_the_saturation_and_keeps_hue_and_value(severity):
    rgb = np.random.default_rng(5).random((20, 15, 3), np.float32)
    rgb[0, 0], rgb[0, 1], rgb[0, 2], rgb[0, 3], rgb[0, 4] = 0, 1, 0.5, (1, 0, 0), (0.2, 0.9, 0.9)
    gain, offset = SATURATIONS[severity - 1]
    for clean, found in zip(rgb.reshape(-1, 3).tolist(), made("saturate", rgb, severity).reshape(-1, 3), strict=True):
        hue, saturation, value = colorsys.rgb_to_hsv(*clean)  # whose hue of grey is 0 too
        expected = colorsys.hsv_to_rgb(hue, min(max(saturation * gain + offset, 0), 1), value)
        np.testing.assert_allclose(found, expected, atol=2e-6)


def places(height, width):
    """A picture of where each pixel is: columns in red, rows in green."""
    image = np.zeros((height, width, 3), dtype=np.float32)
    image[..., 0], image[..., 1] = np.arange(width), np.arange(height)[:, None]
    return image


@cases("severity", [1, 5])
def test_elastic_transform_displaces_as_smoothed_noise_does(severity):
    """Means of many frames against the same law by scipy: standard deviation, correlation with what lies beside."""
    height, width = 150, 200
    at, rng = places(height, width), np.random.default_rng(1)
    most = 0.005 * height
    laws: dict[str, list[float]] = {"found": [], "expected": []}
    for index in range(6):
        moved = (made("elastic_transform", at, severity, index) - at)[..., :2]
        smoothed = np.stack(
            [
                ndimage.gaussian_filter(
                    rng.uniform(-most, most, (height, width)), (0.01 * height, 0.01 * width), truncate=3
                )
                for _ in range(2)
            ],
            -1,
        )
        for kind, field in (("found", moved), ("expected", smoothed * ALPHAS[severity - 1])):
            inner = field[12:-12, 12:-12]
            beside = [(inner[:, :-k, 0] * inner[:, k:, 0]).mean() / (inner[..., 0] ** 2).mean() for k in (1, 3)]
            below = [(inner[:-k, :, 1] * inner[k:, :, 1]).mean() / (inner[..., 1] ** 2).mean() for k in (1, 3)]
            laws[kind].append([inner[..., 0].std(), inner[..., 1].std(), *beside, *below])
    found, expected = (np.mean(laws[kind], axis=0) for kind in ("found", "expected"))
    np.testing.assert_allclose(found, expected, rtol=0.06)


def test_elastic_transform_is_fresh_or_fixed():
    rgb = picture()
    first, second = (apply(rgb, "elastic_transform", 3, seed=1, frame=frame) for frame in (0, 1))
    assert np.abs(first - second).mean() > 1e-3
    kept = [apply(rgb, "elastic_transform", 3, seed=1, frame=frame, temporal="fixed") for frame in (0, 1)]
    assert np.array_equal(*kept)
    assert np.array_equal(apply(rgb, "elastic_transform", alpha=0), rgb)


# --- the door ---


def grey_and_colour():
    rgb = (picture() * 255).astype(np.uint8)
    grey = rgb[..., 1]
    return [rgb, grey, grey[..., None], (rgb / 255).astype(np.float32), (grey / 255).astype(np.float32)]


@cases("name", names())
def test_every_name_runs_on_every_kind_of_image(name):
    for image in [image[:40, :50] for image in grey_and_colour()]:
        found = apply(image, name, 3)
        assert (found.shape, found.dtype) == (image.shape, image.dtype)


def test_what_needs_more_than_an_image_is_listed_by_its_kind():
    listed = [names(kind) for kind in ("motion", "exposure", "colour", "depth", "pairing")]
    assert sorted(itertools.chain(*listed)) == sorted(names("all")) == sorted(registry())
    assert set(names("colour")) - set(names()) == {name for name in names("colour") if registry()[name].needs_depth}
    with pytest.raises(ValueError, match="kind is the text 'color'"):
        names("color")


def test_grey_noise_is_as_strong_as_that_of_one_channel():
    grey = np.full((200, 200), 128, np.uint8)
    for name, of_255 in (("gaussian_noise", 0.08 * 255), ("speckle_noise", 0.15 * 128)):  # ImageNet-C's, severity 1
        assert (apply(grey, name, 1).astype(float) - 128).std() == pytest.approx(of_255, rel=0.03)
    for name in ("contrast", "gaussian_blur"):  # what treats channels alike stays grey
        soft = grey_and_colour()[1]
        assert np.array_equal(apply(soft, name, 2), apply(np.repeat(soft[..., None], 3, -1), name, 2)[..., 0])


def test_corrupt_is_imagecorruptions_door():
    assert get_corruption_names() == get_corruption_names("all")[:15]
    assert get_corruption_names("validation") == ["speckle_noise", "gaussian_blur", "spatter", "saturate"]
    assert get_corruption_names("weather") == ["snow", "frost", "fog", "brightness"]
    rgb = grey_and_colour()[0]
    for number, name in enumerate(get_corruption_names("all")):
        found = corrupt(rgb, 2, name, seed=4)
        assert np.array_equal(found, corrupt(rgb, severity=2, corruption_number=number, seed=4))
        assert np.array_equal(found, apply(rgb, name, 2, seed=4))
    np.random.seed(6)  # noqa: NPY002 - as those who come from there do
    first, second = corrupt(rgb, 1, "shot_noise"), corrupt(rgb, 1, "shot_noise")
    np.random.seed(6)  # noqa: NPY002
    assert np.array_equal(corrupt(rgb, 1, "shot_noise"), first)
    assert not np.array_equal(first, second)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({}, "corruption_number from 0 to 18"),
        ({"corruption_number": 19}, "corruption_number from 0 to 18"),
        ({"corruption_name": "fog_depth"}, "corruption_name is the text 'fog_depth'"),
        ({"corruption_name": "fog", "severity": 6}, "severity is the number 6"),
    ],
)
def test_corrupt_says_what_it_wants(arguments, told):
    with pytest.raises(ValueError, match=told):
        corrupt(grey_and_colour()[0], **arguments)


def test_corrupt_takes_bytes_alone():
    with pytest.raises(TypeError, match="float32, but has to be a uint8"):
        corrupt(picture(), 1, "fog")
    with pytest.raises(ValueError, match="subset is the text 'every'"):
        get_corruption_names("every")


def test_the_page_for_those_who_come_from_there_runs_as_it_stands():
    page = (ROOT / "docs/imagecorruptions.md").read_text(encoding="utf-8")
    image = grey_and_colour()[0][:40, :50]
    given = {"image": image, "depth_m": np.full(image.shape[:2], 2.0, np.float32)}
    for block in re.findall(r"```python\n(.*?)\n```", page, re.DOTALL):
        exec(compile(block, "imagecorruptions.md", "exec"), given)
    assert given["corrupted"].shape == given["foggy"].shape == image.shape
