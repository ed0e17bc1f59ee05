# SPDX-License-Identifier: GPL-3.0-or-later
"""A metric and a system of an installed package: in lists, in a study's tables and report, and what is refused."""

import csv
import json
import sys

import installed_package
import numpy as np
import pytest
import yaml
from study_tools import FRAMES, PROGRAM, SETTINGS, evaluate, rows_of, small_world
from worlds import path_poses

from noisy_world.cli import command
from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.trajectory import Trajectory
from noisy_world.evaluate.estimates import Estimate
from noisy_world.evaluate.metrics import METRICS
from noisy_world.evaluate.study_results import merged, why_not
from noisy_world.evaluate.systems import find_system, system_names
from noisy_world.evaluate.trajectory_scores import score_trajectory

UPWARD = """
import numpy as np

from noisy_world.extend import Compared, TrajectoryMetric


def compute(compared: Compared) -> float | None:
    return float(np.abs(compared.estimate[:, 2, 3] - compared.true[:, 2, 3]).max())


METRIC = TrajectoryMetric(
    "upward_max_m", "largest error upwards", "m", "lower", "the largest distance along the world's z.", compute
)
"""
# Where each pose is moved along the world's z by 1 cm, and back: alignment moves none of it.
TREMBLING = PROGRAM.replace(
    'pose = list(rows[frame["index"]])',
    """pose = list(rows[frame["index"]])
        pose[2] += 0.01 * (-1) ** frame["index"]""",
)
ENTRIES = {"metrics": {"upward": "studio_slam.upward:METRIC"}, "systems": {"all": "studio_slam.systems"}}


def definition(name, way):
    words = [sys.executable, "-I", "-S", "{here}/program.py", "poses", "{frames}", "{out}", str(way)]
    return yaml.safe_dump({"name": name, "about": "It trembles.", "command": words, "writes": {"file": "poses.txt"}})


@pytest.fixture
def site(tmp_path, monkeypatch):
    """The package, installed into this process."""
    way = tmp_path / "way.txt"
    poses = path_poses(FRAMES)
    rotation = pytest.importorskip("scipy.spatial.transform", reason="scipy comes with an extra").Rotation
    quats_xyzw = rotation.from_matrix(poses[:, :3, :3]).as_quat()
    way.write_text(
        "".join(" ".join(map(repr, row)) + "\n" for row in np.hstack([poses[:, :3, 3], quats_xyzw]).tolist())
    )
    modules = {
        "__init__.py": "",
        "upward.py": UPWARD,
        "systems/__init__.py": "",
        "systems/program.py": TREMBLING,
        "systems/trembling.yaml": definition("trembling", way),
    }
    yield installing(
        monkeypatch, installed_package.install(tmp_path / "site", "studio-slam", "1.2", ENTRIES, modules, kind=None)
    )
    forget()


def installing(monkeypatch, folder):
    monkeypatch.syspath_prepend(str(folder))
    METRICS.forget()
    return folder


def forget():
    METRICS.forget()
    for name in [item for item in sys.modules if item.partition(".")[0] in ("studio_slam", "broken_slam")]:
        del sys.modules[name]


def test_a_study_has_both(site, tmp_path, capfd):
    for package in ("tabulate", "pandas", "jinja2", "matplotlib"):
        pytest.importorskip(package, reason=f"{package} comes with the extra evaluate")
    assert command.main(["list", "metrics"]) == 0
    lines = [line.split(maxsplit=1) for line in capfd.readouterr().out.splitlines()]
    assert ["upward_max_m", "largest error upwards [m], lower is better; from studio-slam 1.2"] in lines
    assert command.main(["systems"]) == 0
    assert "trembling (from studio-slam 1.2): can be run here\n    It trembles.\n" in capfd.readouterr().out
    preset = small_world(tmp_path / "world", settings=SETTINGS[:1])
    assert evaluate(preset, "--systems", "trembling", "--out", tmp_path / "out", report=True) == 0
    (row,) = rows_of(tmp_path / "out")
    assert row["system"] == "trembling"
    # The trembling is 1 cm to both sides of its mean, less the little by which a tilt follows it.
    assert 0.008 < float(row["upward_max_m"]) < 0.0105
    assert "largest error upwards" in (tmp_path / "out/report.md").read_text()
    with (tmp_path / "out/tables/settings.csv").open(newline="") as file:
        (told,) = csv.DictReader(file)
    assert float(told["upward_max_m.mean"]) == pytest.approx(float(row["upward_max_m"]), rel=1e-12)  # a mean of logs
    study = json.loads((tmp_path / "out/study.json").read_text())["study"]
    assert study["metrics"] == {"upward_max_m": "studio-slam 1.2"}
    newer = {**study, "metrics": {"upward_max_m": "studio-slam 1.3"}}
    assert why_not(study, newer) == "the metric upward_max_m is of studio-slam 1.2, and here of studio-slam 1.3"
    without = {key: value for key, value in study.items() if key != "metrics"}
    assert why_not(study, without) == why_not(without, study) == ""
    before = {key: value for key, value in study.items() if key != "definitions"}
    assert why_not(before, before) == ""
    assert "definitions" in why_not(before, study)
    assert merged(without, study)["metrics"] == merged(study, without)["metrics"] == study["metrics"]


def test_a_run_that_failed_has_no_value(site):
    truth = Trajectory(path_poses(5), np.arange(5.0))
    assert score_trajectory(Estimate(np.zeros(0), np.zeros((0, 4, 4))), truth).values["upward_max_m"] is None
    assert score_trajectory(Estimate(truth.stamps_s, truth.c2w), truth).values["upward_max_m"] < 1e-12


METRIC = "from noisy_world.extend import TrajectoryMetric\nMETRIC = TrajectoryMetric('{}', 'X', '', '', 'X.', {})\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (METRIC.format("losses", "len"), "its metric losses has the name of one of our own; rename it"),
        (METRIC.format("A b", "len"), "cannot be loaded: ValueError: 'A b' is no name"),
        ("METRIC = len", "is a builtin_function_or_method, but has to be a TrajectoryMetric"),
        (METRIC.format("x", "lambda compared: float('nan')"), "the metric x gave nan, but has to give a finite number"),
        (METRIC.format("x", "lambda compared: 'much'"), "the metric x gave much, but has to give a finite number"),
    ],
)  # fmt: skip
def test_a_broken_metric_is_one_line(monkeypatch, tmp_path, text, told):
    modules = {"__init__.py": "", "metric.py": text}
    try:
        installing(
            monkeypatch,
            installed_package.install(tmp_path, "broken-slam", "0.1", {"x": "broken_slam"}, modules, kind="metrics"),
        )
        truth = Trajectory(path_poses(5), np.arange(5.0))
        with pytest.raises(NoisyWorldError) as raised:
            score_trajectory(Estimate(truth.stamps_s, truth.c2w), truth)
    finally:
        forget()
    assert str(raised.value).startswith("broken-slam 0.1: ")
    assert told in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("entry", "files", "told"),
    [
        ("broken_slam", {}, "broken-slam 0.1: the entry point x = broken_slam holds no system; put the definitions"),
        ("broken_slam:__name__", {}, "is no package; name the package that holds the definitions"),
        ("broken_slam", {"orb_slam3.yaml": ""}, "its system orb_slam3 has the name of one of our own"),
        ("broken_slam", {"a.yaml": "name: a\n"}, "a.yaml: command: is missing"),
        ("broken_slam", {"a.yaml": definition("b", "way")}, "a.yaml defines b; name the file like the system"),
    ],
)
def test_a_broken_system_is_one_line(monkeypatch, tmp_path, entry, files, told):
    modules = {"__init__.py": "", **files}
    installed_package.install(tmp_path, "broken-slam", "0.1", {"x": entry}, modules, kind="systems")
    try:
        monkeypatch.syspath_prepend(str(tmp_path))
        with pytest.raises(NoisyWorldError) as raised:
            [find_system(name) for name in system_names()]
    finally:
        forget()
    assert str(raised.value).startswith("broken-slam 0.1: ")
    assert told in str(raised.value)
    assert "\n" not in str(raised.value)
