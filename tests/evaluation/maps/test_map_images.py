# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers of images: against closed forms, a second calculation, and a network written by hand."""

import math

import numpy as np
import pytest
from onnx_files import mean_difference
from refusals import refused

from noisy_world.evaluate.map_metrics import Perceptual, psnr_db, ssim


def _images(seed=0, height=20, width=24):
    random = np.random.default_rng(seed)
    first = random.integers(0, 256, (height, width, 3), dtype=np.uint8)
    second = np.clip(first.astype(int) + random.integers(-30, 31, first.shape), 0, 255).astype(np.uint8)
    return first, second


def test_psnr_of_a_step_is_its_closed_form():
    first = np.full((8, 9, 3), 100, np.uint8)
    assert psnr_db(first, first + np.uint8(10)) == pytest.approx(20 * math.log10(25.5), abs=1e-9)
    assert psnr_db(first, first) == 100.0


def test_ssim_is_wang_s_formula():
    first, second = _images()
    window = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    window = np.outer(window, window) / window.sum() ** 2
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    numbers = []
    for channel in range(3):
        x, y = (np.pad(image[..., channel].astype(float), 5, mode="reflect") for image in (first, second))
        for row in range(first.shape[0]):
            for column in range(first.shape[1]):
                a, b = (image[row : row + 11, column : column + 11] for image in (x, y))
                mean_a, mean_b = (window * a).sum(), (window * b).sum()
                var_a, var_b = (window * a * a).sum() - mean_a**2, (window * b * b).sum() - mean_b**2
                both = (window * a * b).sum() - mean_a * mean_b
                top = (2 * mean_a * mean_b + c1) * (2 * both + c2)
                numbers.append(top / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2)))
    assert ssim(first, second) == pytest.approx(np.mean(numbers), abs=2e-4)
    assert ssim(first, first) == pytest.approx(1.0, abs=1e-6)


def test_a_network_tells_how_far_two_images_are(tmp_path):
    file = tmp_path / "mean.onnx"
    file.write_bytes(mean_difference(20, 24))
    first, second = _images()
    expected = np.abs(first.astype(float) - second).mean() / 127.5
    assert Perceptual(file)(first, second) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "cannot load"),
        (b"no network", "cannot load"),
        (mean_difference(20, 24, names=("left", "right")), "cannot run"),
        (mean_difference(20, 24, output_sizes=(1, 3, 20, 24)), "not one number"),
    ],
)
def test_another_file_is_refused_in_a_line(tmp_path, content, problem):
    file = tmp_path / "other.onnx"
    file.write_bytes(content)
    refused(lambda: Perceptual(file)(*_images()), names=[str(file), problem, "in0 and in1"])


def test_a_missing_file_is_said(tmp_path):
    refused(Perceptual, tmp_path / "none.onnx", names=str(tmp_path / "none.onnx"))
