# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world score --plot`: what is drawn is what was scored, and what cannot be drawn is one line."""

import cv2
import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="the extra evaluate is not installed")

from matplotlib.figure import Figure

from noisy_world.cli import command
from noisy_world.core.trajectory import Trajectory
from noisy_world.evaluate.estimates import Estimate
from noisy_world.evaluate.run_figures import ScoredPath, draw_scored_path, plane_of
from noisy_world.evaluate.trajectory_scores import score_trajectory
from noisy_world.trajectories.stamped_poses import tum_text

COUNT, LOST = 30, (10, 11, 12)


def driven():
    """A path over the ground of a world whose y axis points down, as KITTI's: x and z are the plane."""
    at = np.linspace(0.0, 3.0, COUNT)
    c2w = np.tile(np.eye(4), (COUNT, 1, 1))
    c2w[:, :3, 3] = np.stack([4.0 * np.sin(at), 0.01 * np.cos(at), 6.0 * at], axis=1)
    return Trajectory(c2w, 0.1 * np.arange(COUNT))


def estimated(truth):
    """The truth with every pose but those of LOST, each 2 cm to one side or the other."""
    kept = np.setdiff1d(np.arange(COUNT), LOST)
    c2w = truth.c2w[kept].copy()
    c2w[:, 1, 3] += 0.02 * (-1.0) ** np.arange(len(kept))
    return Estimate(truth.stamps_s[kept], c2w)


@pytest.fixture
def files(tmp_path):
    truth = driven()
    found = estimated(truth)
    (tmp_path / "truth.txt").write_text(tum_text(truth))
    (tmp_path / "estimate.txt").write_text(tum_text(Trajectory(found.c2w, found.stamps_s)))
    (tmp_path / "still.txt").write_text(tum_text(Trajectory(np.tile(np.eye(4), (COUNT, 1, 1)), truth.stamps_s)))
    return tmp_path


def score(*words):
    return command.main(["score", *map(str, words)])


def test_what_is_drawn_is_what_was_scored():
    truth = driven()
    scored = score_trajectory(estimated(truth), truth)
    figure = Figure()
    draw_scored_path(figure, ScoredPath(truth.c2w[:, :3, 3], scored.frame_errors, "a title"))
    over, below = figure.axes[:2]
    assert (over.get_xlabel(), over.get_ylabel()) == ("world x [m]", "world z [m]")  # looked at along y
    lines = {line.get_label(): line.get_xydata() for line in over.lines}
    assert np.array_equal(lines["true path"], truth.c2w[:, [0, 2], 3])
    assert np.array_equal(lines["frame without a pose"], truth.c2w[list(LOST)][:, [0, 2], 3])
    (points,) = over.collections
    assert np.allclose(points.get_offsets(), np.delete(truth.c2w[:, [0, 2], 3], LOST, axis=0), atol=5e-3)
    assert np.allclose(points.get_array(), 0.02, atol=5e-3)
    times_s, error_m = below.lines[0].get_xydata().T
    assert np.allclose(times_s, 0.1 * np.arange(COUNT))
    assert np.flatnonzero(np.isnan(error_m)).tolist() == list(LOST)
    assert np.allclose(below.lines[1].get_xdata(), 0.1 * np.array(LOST))


@pytest.mark.parametrize(
    ("extent", "plane"), [((5, 3, 0), (0, 1)), ((5, 0, 3), (0, 2)), ((0, 1, 3), (1, 2)), ((1, 0, 0), (0, 1))]
)
def test_a_path_is_seen_along_the_axis_in_which_it_extends_least(extent, plane):
    assert plane_of(np.array([[0.0, 0.0, 0.0], extent])) == plane


def test_pictures_of_every_kind(files, capsys):
    plots = [files / name for name in ("plot.png", "plot.SVG", "plot.pdf")]
    assert [score(files / "estimate.txt", files / "truth.txt", "--plot", plot) for plot in plots] == [0, 0, 0]
    assert "27 of 30 frames" in capsys.readouterr().out  # the table is printed all the same
    image = cv2.imread(str(plots[0]))
    assert min(image.shape[:2]) > 600
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 50
    assert plots[1].read_bytes().startswith(b"<?xml")
    assert plots[2].read_bytes().startswith(b"%PDF")
    first = plots[0].read_bytes()
    assert score(files / "estimate.txt", files / "truth.txt", "--plot", plots[0]) == 0
    assert plots[0].read_bytes() == first


def test_a_run_that_failed_is_drawn_too(files, capsys):
    assert score(files / "still.txt", files / "truth.txt", "--plot", files / "plot.svg") == 0
    assert "FAILED (stands_still)" in capsys.readouterr().out
    assert (files / "plot.svg").stat().st_size > 1000


def test_what_cannot_be_drawn_is_one_line(files, capsys, monkeypatch):
    with pytest.raises(SystemExit) as ended:
        score(files / "estimate.txt", files / "truth.txt", "--plot", files / "plot.txt")
    assert ended.value.code == 2
    assert "has to end in .png, .svg, .pdf" in capsys.readouterr().err.splitlines()[-1]
    assert score(files / "estimate.txt", files / "truth.txt", "--plot", files / "none" / "plot.png") == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    monkeypatch.setattr("noisy_world.core.packages.missing_packages", list)
    assert score(files / "estimate.txt", files / "truth.txt", "--plot", files / "plot.png") == 1
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    assert "matplotlib: missing" in said.err
    assert "evaluate" in said.err
    assert not (files / "plot.png").exists()
