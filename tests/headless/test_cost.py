# SPDX-License-Identifier: GPL-3.0-or-later
"""What the whole benchmark costs: the extrapolation's arithmetic, and that every stage of a run is counted."""

import json
import sys

import pytest
from worlds import ROOT, write_world

sys.path.insert(0, str(ROOT / "headless"))

from bench import cost

SETTINGS = [
    {"name": "clean"},
    {"name": "fog", "perturb": [{"fog": {"severity": 3}}]},
    {"name": "far", "perturb": [{"depth_gaussian_noise": {"severity": 3}}]},
    {"name": "both", "perturb": [{"fog": {"severity": 1}}, {"contrast": {"severity": 1}}]},
]
STAGES = {
    "loading", "rendering", "encoding colour", "encoding depth", "hashing", "writing", "linking", "journals",
    "perturbing: fog", "perturbing: depth_gaussian_noise", "perturbing: fog + contrast",
}  # fmt: skip


def test_hours_of_the_whole():
    seconds = {"loading": 9.0, "rendering": 1.8, "hashing": 0.9}
    found = cost.Cost("x", 4, 64, 1000, seconds, bytes=3, naive_bytes=10, peak_bytes=0)
    # 8 scenes of 2,000 frames are 4,000 times the 4 frames; each of the 8 scenes is loaded once.
    assert found.hours("loading") == pytest.approx(8 * 9 / 3600)
    assert found.hours("rendering") == pytest.approx(2.0)
    assert found.beside_hours == pytest.approx(1.0)
    assert found.whole_hours == pytest.approx(3.02)
    assert found.hours("writing") == 0


def test_a_small_preset_is_measured(tmp_path, capsys):
    pytest.importorskip("embreex", reason="needs the extra: pip install '.[embree]'")
    preset = write_world(tmp_path / "world", frames=7, size=(32, 24), settings=SETTINGS)
    arguments = ["--preset", str(preset), "--frames", "3", "--engine", "embree", "--out", str(tmp_path / "out")]
    assert cost.main(arguments) == 0
    (found,) = json.loads((tmp_path / "out/cost.json").read_text())
    assert set(found["seconds"]) == STAGES
    assert all(value >= 0 for value in found["seconds"].values())
    assert (found["frames"], found["renders"], found["images"]) == (3, 3, 2 * 3 * len(SETTINGS))
    assert 0 < found["bytes"] < found["naive_bytes"]
    assert "| embree, reference |" in capsys.readouterr().out
