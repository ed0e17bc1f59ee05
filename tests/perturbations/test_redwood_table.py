# SPDX-License-Identifier: GPL-3.0-or-later
"""Redwood's model of depth with a table of distortion, against Open3D's simulator and by hand."""

import subprocess

import numpy as np
import pytest
from cases import cases
from worlds import ROOT

from noisy_world.perturb import apply

PEER = ROOT / ".venv-peer" / "bin" / "python"


def write_warp(path, seed=1, *, plain=False):
    """A made-up table: factors that differ from cell to cell and by distance, and cells without any; plain: all 1."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((80, 80, 23))
    cells[..., 18:] = rng.uniform(0.93, 1.07, (80, 80, 5))
    cells[..., 3:8] = np.where(rng.uniform(size=(80, 80, 1)) < 0.1, 7999, rng.choice([0, 8000, 9000], (80, 80, 5)))
    if plain:
        cells[..., 18:], cells[..., 3:8] = 1, 9000
    lines = [" ".join(f"{value:.6f}" for value in cell) for cell in cells.reshape(-1, 23)]
    path.write_text("\n".join(["head"] * 5 + ["% a comment"] + lines) + "\n")
    known = (cells[..., 3:8] >= 8000).any(axis=-1)
    return np.where(known[..., None], np.round(cells[..., 18:], 6), 0.0)


@pytest.mark.skipif(not PEER.exists(), reason="no Open3D: run make peer-env, with a Python 3.11")
@cases("warped", [False, True])
def test_redwood_is_open3ds_deterministic_mode(tmp_path, warped):
    """Open3D gives depth beyond Habitat's 10 m, and always has a table: of factors 1 for a model without."""
    path = tmp_path / "model.txt"
    write_warp(path, plain=not warped)
    depth = np.random.default_rng(0).uniform(0.3, 9.99, (480, 640)).astype(np.float32)
    depth[:20] = 0
    np.save(tmp_path / "depth.npy", depth)
    subprocess.run([str(PEER), str(ROOT / "tests/peer/redwood.py"), str(tmp_path)], check=True, capture_output=True)
    made = apply(depth, "redwood", noise=0.0, **({"warp": str(path)} if warped else {}))
    np.testing.assert_allclose(made, np.load(tmp_path / "made.npy"), atol=1e-6)


@cases(("z_m", "low", "share"), [(0.4, 0, 0.0), (2.0, 0, 0.5), (3.0, 1, 0.0), (8.5, 3, 0.75), (9.5, 4, 0.0)])
def test_redwoods_table_is_interpolated_by_distance_over_the_image(tmp_path, z_m, low, share):
    """In an image of half the table's size, at the middle of each cell of 4 x 3 pixels."""
    table = write_warp(tmp_path / "model.txt", seed=5)
    flat_m = np.full((240, 320), z_m, np.float32)
    made = apply(flat_m, "redwood", noise=0.0, warp=str(tmp_path / "model.txt"), step_px=1e-5)
    factor = table[..., low] * (1 - share) + table[..., min(low + 1, 4)] * share
    found = made[1::3, 1::4]
    np.testing.assert_array_equal(found > 0, factor > 0)
    known = factor > 0
    np.testing.assert_allclose(found[known], z_m / factor[known], rtol=2e-5)
