# SPDX-License-Identifier: GPL-3.0-or-later
"""What colour says of a camera over time and over its files: known in, known out."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from noisy_world.measure.coding import coding

RNG = np.random.default_rng(8)
SAMPLINGS = {
    "jpeg_420_share": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
    "jpeg_422_share": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
    "jpeg_444_share": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
}


def jpeg(quality, sampling=cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420, chroma=None):
    image = RNG.integers(0, 255, (16, 32, 3)).astype(np.uint8)
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    if chroma is not None:
        options += [cv2.IMWRITE_JPEG_LUMA_QUALITY, quality, cv2.IMWRITE_JPEG_CHROMA_QUALITY, chroma]
    return cv2.imencode(".jpg", image, options)[1].tobytes()


def coded(*files):
    """What files of colour say of their coding: figures by name, and remarks."""
    opened = SimpleNamespace(encoded_colour=lambda frame: files[frame])
    found = coding(SimpleNamespace(opened=opened), range(len(files)))
    return {figure.name: figure for figure in found.figures}, " ".join(found.remarks)


@pytest.mark.parametrize("quality", [1, 25, 49, 50, 51, 80, 95, 100])
@pytest.mark.parametrize("share", SAMPLINGS)
def test_quality_and_sampling_of_a_jpeg_are_exact(quality, share):
    figures, _ = coded(jpeg(quality, SAMPLINGS[share]))
    assert figures["jpeg_quality"].value == quality
    assert figures["jpeg_tables_apart_share"].value == 0
    assert {name: figures[name].value for name in SAMPLINGS} == dict.fromkeys(SAMPLINGS, 0) | {share: 1}


def test_tables_of_another_encoder_are_said_to_be():
    figures, remark = coded(jpeg(90, chroma=40))
    assert 40 < figures["jpeg_quality"].value < 95
    assert figures["jpeg_tables_apart_share"].value > 0.1
    assert "not those of libjpeg" in remark


def test_qualities_that_differ_are_said_to_and_what_is_no_jpeg_is_told():
    figures, remark = coded(jpeg(60), jpeg(70), jpeg(80))
    assert [getattr(figures["jpeg_quality"], name) for name in ("low", "value", "high")] == [60.5, 70, 79.5]
    assert "60 to 80" in remark
    figures, _ = coded(cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    assert figures["jpeg_quality"].value is None
    assert "JPEG" in figures["jpeg_quality"].untold


@pytest.mark.parametrize("quality", [50, 80])
def test_a_jpeg_takes_the_noise_that_is_said(quality):
    """Of a grey image with white noise of the deviation that the remark names, a tenth of the variance is left."""
    _, remark = coded(jpeg(quality))
    std = float(remark.split("less than ")[1].split()[0])
    image = np.clip(np.rint(128 + RNG.normal(0, std, (256, 256))), 0, 255).astype(np.uint8)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    left = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE).astype(float).var()
    rounded = 1 / 12  # what whole numbers add, before and after
    assert left - rounded == pytest.approx(0.1 * (std**2 + rounded), rel=0.2)
