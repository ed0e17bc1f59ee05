# SPDX-License-Identifier: GPL-3.0-or-later
"""Indicators, on images and paths whose answer is known."""

import cv2
import numpy as np
import pytest
from refusals import refused

from noisy_world.dataset.opening import open_path
from noisy_world.evaluate import indicators
from noisy_world.evaluate.analyses import depth_distribution, motion_distribution
from noisy_world.evaluate.indicators import AGAINST_CLEAN, INDICATORS, indicators_of, motion_of

WIDTH, HEIGHT = 160, 120


def texture(seed=0, width=WIDTH, height=HEIGHT):
    noise = np.random.default_rng(seed).integers(0, 256, (height, width)).astype(np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.5), None, 0, 255, cv2.NORM_MINMAX)


def write_tum(folder, greys, depths_m, positions, rate_hz=20.0):
    """Write a sequence as TUM has them, by hand; the camera does not turn."""
    rgb, depth, truth = [], [], []
    for place in ("rgb", "depth"):
        (folder / place).mkdir(parents=True)
    for k, (grey, depth_m, p) in enumerate(zip(greys, depths_m, positions, strict=True)):
        stamp = f"{k / rate_hz:.6f}"
        assert cv2.imwrite(str(folder / f"rgb/{stamp}.png"), np.repeat(grey[..., None], 3, axis=2))
        assert cv2.imwrite(str(folder / f"depth/{stamp}.png"), np.rint(depth_m * 5000.0).astype(np.uint16))
        rgb.append(f"{stamp} rgb/{stamp}.png")
        depth.append(f"{stamp} depth/{stamp}.png")
        truth.append(f"{stamp} {p[0]} {p[1]} {p[2]} 0 0 0 1")
    for name, lines in (("rgb", rgb), ("depth", depth), ("groundtruth", truth)):
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


def test_speed_and_acceleration_on_a_circle():
    # Radius 2 m, a turn in 10 s: 1.2566 m/s, 0.7896 m/s^2, 36 degrees/s, and no change of the angular velocity.
    stamps_s = np.arange(200) / 20.0
    angle = 2.0 * np.pi * stamps_s / 10.0
    c2w = np.tile(np.eye(4), (200, 1, 1))
    c2w[:, 0, 0], c2w[:, 0, 1], c2w[:, 1, 0], c2w[:, 1, 1] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    c2w[:, 0, 3], c2w[:, 1, 3] = 1e5 + 2.0 * np.cos(angle), 2.0 * np.sin(angle)
    found = motion_of(c2w, stamps_s)
    assert np.isnan(found["speed_mps"][0])
    assert np.isnan(found["acceleration_mps2"][[0, -1]]).all()
    assert found["speed_mps"][1:] == pytest.approx(2.0 * np.pi * 2.0 / 10.0, rel=1e-4)
    assert found["acceleration_mps2"][1:-1] == pytest.approx(2.0 * (2.0 * np.pi / 10.0) ** 2, rel=1e-3)
    assert found["rotation_speed_degps"][1:] == pytest.approx(36.0, rel=1e-9)
    assert found["rotation_acceleration_degps2"][1:-1] == pytest.approx(0.0, abs=1e-6)


def test_motion_of_uneven_stamps_and_of_few_poses():
    # x = t^2 has acceleration 2 wherever it is looked at: the mean velocity of a step is that of its middle.
    stamps_s = np.array([0.0, 0.1, 0.35, 0.4, 1.0])
    c2w = np.tile(np.eye(4), (5, 1, 1))
    c2w[:, 0, 3] = stamps_s**2
    assert motion_of(c2w, stamps_s)["acceleration_mps2"][1:-1] == pytest.approx(2.0)
    for count in (1, 2):
        found = motion_of(c2w[:count], stamps_s[:count])
        assert all(len(column) == count for column in found.values())
        assert np.isnan(found["acceleration_mps2"]).all()
    half_turn = np.stack([np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0]), np.eye(4)])
    found = motion_of(half_turn, [0.0, 1.0, 2.0])
    assert found["rotation_speed_degps"][1:] == pytest.approx(180.0)


def test_noise_of_an_image_is_estimated_without_a_clean_one():
    rng = np.random.default_rng(1)
    ramp = np.add.outer(np.arange(240) * 0.2, np.arange(320) * 0.3) + 50.0
    assert indicators.image_noise(np.full((240, 320), 7, np.uint8)) == 0.0
    for sigma in (5.0, 20.0):
        noisy = np.rint(ramp + rng.normal(0.0, sigma, ramp.shape)).clip(0, 255).astype(np.uint8)
        assert indicators.image_noise(noisy) == pytest.approx(sigma, rel=0.03)
    assert indicators.image_noise(np.zeros((2, 2), np.uint8)) == 0.0


def test_noise_of_depth_is_nothing_on_any_plane():
    x, y = np.meshgrid(np.arange(320) - 159.5, np.arange(240) - 119.5)
    plane = (1.0 / (0.4 + 0.001 * x - 0.0007 * y)).astype(np.float32)
    assert plane.max() > 2.0 * plane.min()
    assert indicators.depth_noise_m(plane) < 1e-5
    noisy = plane + np.random.default_rng(2).normal(0.0, 0.02, plane.shape).astype(np.float32)
    assert indicators.depth_noise_m(noisy) == pytest.approx(0.02, rel=0.05)
    holes = noisy.copy()
    holes[np.random.default_rng(3).random(holes.shape) < 0.1] = 0.0
    assert indicators.depth_noise_m(holes) == pytest.approx(0.02, rel=0.07)
    assert indicators.depth_missing(holes) == pytest.approx(0.1, abs=0.005)
    nothing = np.zeros((6, 8), np.float32)
    assert indicators.depth_missing(nothing) == 1.0
    assert np.isnan([indicators.depth_noise_m(nothing), indicators.median_depth_m(nothing)]).all()
    assert np.isnan(indicators.depth_error_m(nothing, nothing))


def test_likeness_of_two_images():
    first = texture(4)
    second = np.clip(first.astype(int) + 10, 0, 255).astype(np.uint8)
    expected = np.sqrt(np.mean((first.astype(float) - second) ** 2))
    assert indicators.rmse(first, second) == pytest.approx(expected, rel=1e-6)
    assert indicators.ssim(first, first) == pytest.approx(1.0)
    # Wang et al.'s formula in float64, inside, where no border counts.
    a, b = first.astype(np.float64), texture(5).astype(np.float64)
    offsets = np.arange(-5, 6)
    window = np.exp(-np.add.outer(offsets**2, offsets**2) / (2.0 * 1.5**2))
    window /= window.sum()
    windows = np.lib.stride_tricks.sliding_window_view

    def mean(image):
        return np.einsum("ijkl,kl->ij", windows(image, (11, 11)), window)

    ma, mb = mean(a), mean(b)
    saa, sbb, sab = mean(a * a) - ma**2, mean(b * b) - mb**2, mean(a * b) - ma * mb
    c1, c2 = (0.01 * 255.0) ** 2, (0.03 * 255.0) ** 2
    whole = np.mean((2 * ma * mb + c1) * (2 * sab + c2) / ((ma**2 + mb**2 + c1) * (saa + sbb + c2)))
    assert indicators.ssim(first, texture(5)) == pytest.approx(whole, abs=0.01)


def test_features_are_tracked_as_by_brute_force():
    scene = texture(6, 340, 250)
    first, second = (
        indicators.features_of(np.ascontiguousarray(scene[y : y + 240, x : x + 320])) for x, y in ((0, 0), (7, 4))
    )
    orb = cv2.ORB.create(nfeatures=indicators.FEATURES)
    found = [
        orb.detectAndCompute(np.ascontiguousarray(scene[y : y + 240, x : x + 320]), None)[1]
        for x, y in ((0, 0), (7, 4))
    ]
    distance = np.array([[cv2.norm(a, b, cv2.NORM_HAMMING) for b in found[1]] for a in found[0][:60]])
    nearest = distance.argmin(axis=1)
    alike = first.signs[:60] @ second.signs.T
    assert np.array_equal(alike, 256.0 - 2.0 * distance)
    assert np.array_equal(alike.argmax(axis=1), nearest)
    assert indicators.tracked_features(first, second) > 0.5 * len(first)
    assert indicators.tracked_features(first, first) > 0.9 * len(first)
    empty = indicators.features_of(np.full((HEIGHT, WIDTH), 100, np.uint8))
    assert len(empty) == 0
    assert indicators.tracked_features(first, empty) == indicators.tracked_features(empty, first) == 0
    assert indicators.tracked_features(first, indicators.features_of(texture(99, 320, 240))) < 0.05 * len(first)


def test_indicators_of_a_folder(tmp_path):
    scene = texture(7, WIDTH + 40, HEIGHT)
    greys = [scene[:, 4 * k : 4 * k + WIDTH] for k in range(6)]
    depth = np.full((HEIGHT, WIDTH), 2.0)
    depth[: HEIGHT // 4] = 0.0
    positions = [(0.1 * k, 0.0, 0.0) for k in range(6)]
    noisy = write_tum(tmp_path / "noisy", [255 - grey for grey in greys], [depth] * 6, positions)
    clean = write_tum(tmp_path / "clean", greys, [np.full((HEIGHT, WIDTH), 2.5)] * 6, positions)
    found = indicators_of(noisy, clean)
    assert list(found.per_frame) == ["index", "stamp_s", *INDICATORS]
    assert {len(column) for column in found.per_frame.values()} == {6}
    values = found.values
    assert (values["frames"], values["frames_looked_at"]) == (6, 6)
    assert values["depth_missing_mean"] == pytest.approx(0.25)
    assert values["depth_error_m_mean"] == pytest.approx(0.5)
    assert values["depth_median_m_mean"] == pytest.approx(2.0)
    assert values["speed_mps_mean"] == pytest.approx(2.0, rel=1e-5)
    assert values["acceleration_mps2_high"] == pytest.approx(0.0, abs=1e-4)
    assert values["brightness_mean"] == pytest.approx(np.mean([255 - grey.mean() for grey in greys]), abs=0.1)
    rmse = [np.sqrt(np.mean((255.0 - 2.0 * grey) ** 2)) for grey in greys]
    assert values["image_rmse_mean"] == pytest.approx(np.mean(rmse), rel=1e-4)
    assert values["psnr_db_mean"] == pytest.approx(np.mean(20.0 * np.log10(255.0 / np.array(rmse))), rel=1e-4)
    assert values["ssim_mean"] < 0.0
    assert np.isnan(found.per_frame["orb_tracked"][0])
    assert np.all(found.per_frame["orb_tracked"][1:] > 0.3 * found.per_frame["orb_found"][1:])
    assert indicators_of(noisy, clean).values == values
    assert all(np.isfinite(value) for value in values.values() if value is not None)
    assert indicators_of(open_path(clean)["clean"], clean).values["psnr_db_mean"] is None  # equal images


def test_frames_are_sampled_alike(tmp_path):
    greys = [texture(k) for k in range(7)]
    folder = write_tum(tmp_path / "a", greys, [np.ones((HEIGHT, WIDTH))] * 7, [(0.0, 0.0, 0.0)] * 7)
    whole, some = indicators_of(folder, every=1), indicators_of(folder, every=3)
    assert np.flatnonzero(np.isfinite(some.per_frame["brightness"])).tolist() == [0, 3, 6]
    for name in INDICATORS:
        seen = np.isfinite(some.per_frame[name])
        assert np.array_equal(some.per_frame[name][seen], whole.per_frame[name][seen])
    assert all(some.values[f"{name}_mean"] is None for name in AGAINST_CLEAN)
    refused(indicators_of, folder, every=0, names="every", error=ValueError)


def test_clean_frames_are_found_by_pose(tmp_path):
    greys = [texture(k) for k in range(6)]
    depths = [np.full((HEIGHT, WIDTH), 1.0 + k) for k in range(6)]
    path = [(float(k), 0.0, 0.0) for k in range(6)]
    clean = write_tum(tmp_path / "clean", greys, depths, path)
    faster = write_tum(tmp_path / "faster", greys[::2], depths[::2], path[::2])
    assert indicators_of(faster, clean).values["depth_error_m_high"] == 0.0
    moved = write_tum(tmp_path / "moved", greys, depths, [(x + 0.01, 0.0, 0.0) for x, _, _ in path])
    assert indicators_of(moved, clean).values["ssim_mean"] is None
    small = write_tum(tmp_path / "small", [grey[:60] for grey in greys], [d[:60] for d in depths], path)
    assert indicators_of(small, clean).values["ssim_mean"] is None


def test_a_folder_of_several_sequences_is_not_one(tmp_path):
    for name in ("a", "b"):
        write_tum(tmp_path / name, [texture()], [np.ones((HEIGHT, WIDTH))], [(0.0, 0.0, 0.0)])
    refused(indicators_of, tmp_path, names=[str(tmp_path), "2 sequences"])
    one = indicators_of(tmp_path / "a")
    assert one.values["speed_mps_mean"] is None
    assert one.values["orb_tracked_mean"] is None


def test_distributions_of_depth_and_motion(tmp_path):
    depth = np.zeros((HEIGHT, WIDTH))
    depth[0, :4] = (0.3, 0.3, 9.9, 12.0)
    folder = write_tum(tmp_path / "a", [texture()] * 3, [depth] * 3, [(float(k), 0.0, 0.0) for k in range(3)])
    sequence = open_path(folder)["a"]
    table = depth_distribution(sequence, every=1).set_index("from_m")
    assert table["pixels"][table["pixels"] > 0].to_dict() == {0.25: 6, 9.75: 3, 10.0: 3}
    assert table["share"].sum() == pytest.approx(1.0)
    assert np.isinf(table["to_m"].iloc[-1])
    assert motion_distribution(sequence)["speed_mps"].to_numpy() == pytest.approx(20.0)
