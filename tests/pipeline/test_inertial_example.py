# SPDX-License-Identifier: GPL-3.0-or-later
"""The example that runs ORB-SLAM3 with an IMU on a sequence of the layout euroc, with a system of the test's own."""

import sys
from enum import Enum
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_imu_files import felt
from runs import run
from written import rows_of

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

pytestmark = pytest.mark.usefixtures("no_blender")


def true_places(sequence):
    """Stamps in nanoseconds and positions, (N, 4)."""
    rows = rows_of(sequence / "mav0/state_groundtruth_estimate0/data.csv")
    return np.array([[float(cell) for cell in row[:4]] for row in rows])


class State(Enum):
    OK = 2
    NOT_INITIALIZED = 1


class Tracker:
    """Writes the true path, turned and moved and `scale` times as large; the first two frames are not tracked."""

    scale = 1.1

    def __init__(self, vocabulary, settings, sensor):
        self.settings, self.sensor, self.shown = Path(settings).name, sensor, []
        Tracker.last = self

    def track_monocular(self, grey, stamp_s, felt):
        return self.shown.append((stamp_s, None, felt)) or self.found()

    def track_rgbd(self, grey, steps, stamp_s, felt):
        return self.shown.append((stamp_s, steps, felt)) or self.found()

    def found(self):
        return SimpleNamespace(state=State.OK if len(self.shown) > 2 else State.NOT_INITIALIZED)

    def imu_initialized(self):
        return len(self.shown) > 4

    def save_trajectory_euroc(self, path):
        truth = true_places(self.sequence)
        rows = [truth[np.abs(truth[:, 0] - 1e9 * stamp_s).argmin()] for stamp_s, _, _ in self.shown[2:]]
        text = [[row[0], *(self.scale * TURN @ row[1:4] + 5.0), 0, 0, 0, 1] for row in rows]
        np.savetxt(path, text, fmt="%.9f")


@pytest.fixture
def example(monkeypatch):
    sensor = SimpleNamespace(IMU_RGBD="rgbd", IMU_MONOCULAR="mono")
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.setitem(sys.modules, "pyorbslam3", SimpleNamespace(Slam=Tracker, Sensor=sensor))
    import orb_slam3_inertial

    return orb_slam3_inertial


def test_each_frame_is_shown_with_the_samples_since_the_last(tmp_path, example, capsys, monkeypatch):
    run(felt(tmp_path / "w", "euroc"), tmp_path / "out")
    sequence = tmp_path / "out/clean/box"
    monkeypatch.setattr(Tracker, "sequence", sequence, raising=False)
    for mode in ("rgbd", "mono"):
        assert example.main([str(sequence), mode, "vocabulary", str(tmp_path / mode)]) == 0
        said = capsys.readouterr().out
        assert "10 of 12 frames tracked; IMU initialised: 0.2 s" in said
        assert "scale is 1.1000" in said
        shown = Tracker.last.shown
        assert (Tracker.last.sensor, Tracker.last.settings) == (mode, f"orb_slam3_{mode}_inertial.yaml")
        stamps_ns = [int(row[0]) for row in rows_of(sequence / "mav0/cam0/data.csv")]
        assert np.allclose([stamp_s for stamp_s, _, _ in shown], np.array(stamps_ns) * 1e-9, atol=1e-12)
        # 200 Hz and 20 frames a second: the first frame's one sample, then ten each, in the file's order of columns.
        assert [len(felt) for _, _, felt in shown] == [1, *[10] * 11]
        samples = np.array([[float(cell) for cell in row] for row in rows_of(sequence / "mav0/imu0/data.csv")])
        together = np.concatenate([felt for _, _, felt in shown])
        assert np.array_equal(together[:, 1:], samples[: len(together), 1:])
        assert np.allclose(together[:, 0], samples[: len(together), 0] * 1e-9, atol=1e-12)
        if mode == "rgbd":  # steps as they are stored, which the settings divide
            assert all(steps.dtype == np.float32 for _, steps, _ in shown)
            assert max(steps.max() for _, steps, _ in shown) > 500


def test_the_error_is_that_of_the_best_rigid_motion(tmp_path, example, monkeypatch):
    run(felt(tmp_path / "w", "euroc"), tmp_path / "out")
    sequence = tmp_path / "out/clean/box"
    monkeypatch.setattr(Tracker, "sequence", sequence, raising=False)
    example.main([str(sequence), "mono", "vocabulary", str(tmp_path / "a")])
    error_m, scale = example.absolute_error(sequence, tmp_path / "a/trajectory.txt")
    truth = true_places(sequence)
    frames_ns = [int(row[0]) for row in rows_of(sequence / "mav0/cam0/data.csv")][2:]
    points = np.array([truth[np.abs(truth[:, 0] - stamp).argmin(), 1:4] for stamp in frames_ns])
    # A path that is right but for its scale is off by a tenth of each point's distance from the middle.
    away_m = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert error_m == pytest.approx(0.1 * away_m, rel=1e-5)
    assert scale == pytest.approx(1.1, rel=1e-6)
