# SPDX-License-Identifier: GPL-3.0-or-later
"""Every kind of setting that a preset may say is studied, killed, resumed, reported and scored, and searched along."""

import contextlib
import io
import json
import signal
import subprocess
import sys

import pytest
import yaml
from results_made import without_analyses, without_pictures
from study_tools import evaluate, rows_of, small_world, told, write_systems
from worlds import ROOT

from noisy_world.cli import command
from noisy_world.evaluate.figures import Picture
from noisy_world.perturbations import registry
from noisy_world.perturbations.kinds import SEQUENCE_KINDS
from noisy_world.perturbations.parsing import is_sensor

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("tabulate", reason="tabulate comes with an extra")
pytest.importorskip("matplotlib", reason="matplotlib comes with an extra")

FRAMES = 3  # fewer cannot be aligned
TOGETHER = 7  # perturbations of colour or depth in a setting, each three times; chosen: a run takes longer than they do
MODES = ({"severity": 2}, {"severity": 2, "mode": "dynamic"}, {"mode": "keyed", "levels": [1, 4.5]})
NEEDED = {"faster_motion": {"factor": 2}, "desync": {"offset": 1}}
"""Parameters of perturbations that have no severity."""

KILLED = """
import os, signal, sys
sys.path.insert(0, sys.argv[1])
from noisy_world.evaluate import study_results as results
from noisy_world.cli import command
write, left = results.write_atomic, [int(sys.argv[2])]
def ending(path, data, scratch):
    left[0] -= path.name == results.SCORES
    if left[0] < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    write(path, data, scratch)
results.write_atomic = ending
sys.exit(command.main(["evaluate", *sys.argv[3:]]))
"""


def of_each_perturbation():
    """Settings in which each perturbation that there is stands in every mode that it has, together where it goes."""
    kinds = list(registry().values())
    of_path = [kind.name for kind in kinds if isinstance(kind, SEQUENCE_KINDS) and kind.name != "motion_deviation"]
    found = [[{"motion_deviation": {"rotation_deg": 1}}]]  # goes with no exposure
    found += [[{name: NEEDED.get(name, MODES[0])} for name in of_path]]
    found += [[{kind.name: mode}] for kind in kinds if is_sensor(kind) for mode in MODES[1:]]
    images = [kind for kind in kinds if not isinstance(kind, SEQUENCE_KINDS) and not is_sensor(kind)]
    once = [kind for kind in images if getattr(kind, "automatic", None) is not None]
    found += [[{kind.name: mode} for kind in once] for mode in MODES]
    others = [kind for kind in images if kind not in once]
    groups = [others[k : k + TOGETHER] for k in range(0, len(others), TOGETHER)]
    found += [[{kind.name: mode} for kind in group for mode in MODES] for group in groups]
    assert {name for perturb in found for step in perturb for name in step} == set(registry())
    return [{"name": f"{number}", "perturb": perturb} for number, perturb in enumerate(found)]


def settings_of_all(folder):
    others = [{"name": "fixed", "stream": "shared", "perturb": [{"fog": {"severity": 3, "temporal": "fixed"}}]}]
    (folder / "others.yaml").write_text(yaml.safe_dump({"settings": others}))
    return [
        {"name": "clean"},
        *of_each_perturbation(),
        {"name": "mixed", "perturb": [{"frost": MODES[1]}, {"desync": {"offset": 1}}, {"drift": {"severity": 1}}]},
        {"name": "late", "perturb": [{"desync": {"offset": 1, "mode": "dynamic"}}]},
        {"name": "none", "perturb": [{"snow": {"severity": 0}}, {"fog": {"mode": "keyed", "levels": [0]}}]},
        {"name": "given", "stream": "shared", "perturb": [{"gaussian_noise": {"std": 0.1}}]},
        {"name": "seen", "perturb": [{"device": "realsense_d435"}]},
        {"sweep": {"perturb": ["frost"], "severities": [1], "modes": ["static", "dynamic"]}},
        {"include": "others.yaml"},
    ]


RIG = {
    "depth": {
        "sensor": "realsense_d435",
        "width": 20,
        "height": 16,
        "horizontal_fov_deg": 80,
        "registered": True,
        "delay_ms": 4.0,
        "translation_m": [0.05, 0, 0],
    },
    "imu": {"device": "adis16448"},
}
ON_A_RIG = [
    {"name": "clean"},
    {"name": "depth", "perturb": [{"depth_gaussian_noise": mode} for mode in MODES]},
    {"name": "moved", "perturb": [{"vibration": {"severity": 1}}, {"rolling_shutter": {"severity": 2}}]},
]


def run(*words):
    """Run a command in this process; return its status and what it printed."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said):
            return command.main([str(word) for word in words]), said.getvalue()
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@pytest.fixture(scope="module")
def worlds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("every")
    small_world(folder / "all", frames=FRAMES, size=(16, 12), settings=[])
    path = folder / "all/preset.yaml"
    preset = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump({**preset, "settings": settings_of_all(folder / "all")}))
    small_world(folder / "rig", frames=FRAMES, size=(16, 12), settings=ON_A_RIG, rig=RIG, output={"layout": "euroc"})
    write_systems(folder / "systems", "fine", frames=FRAMES)
    return folder


@pytest.fixture
def quick(monkeypatch):
    without_analyses(monkeypatch)
    without_pictures(monkeypatch)


@pytest.mark.parametrize(("name", "killed_at"), [("all", 12), ("rig", 2)])
def test_every_setting_is_studied(worlds, name, killed_at, quick, monkeypatch):
    out = worlds / f"results_{name}"
    words = [worlds / name / "preset.yaml", "--systems", worlds / "systems/fine.yaml", "--jobs", 1, "--out", out]
    words += ["--keep", "--no-report"]
    code = [sys.executable, "-c", KILLED, str(ROOT / "addon"), str(killed_at), *map(str, words)]
    dead = subprocess.run(code, capture_output=True, text=True, timeout=300, check=False)
    assert dead.returncode == -signal.SIGKILL, dead.stderr
    assert evaluate(*words) == 0
    rows = rows_of(out)
    assert len(rows) == len(ON_A_RIG) if name == "rig" else len(settings_of_all(worlds / "all")) + 1  # a sweep of two
    with monkeypatch.context() as patched:
        patched.setattr("noisy_world.evaluate.study.run_system", None)
        before = told(out)
        assert evaluate(*words) == 0  # reads what is there, and runs nothing
    assert told(out) == before
    assert run("report", out)[0] == 0
    for row in rows:
        case = f"{row['scene']}/{row['setting']}/seed-{row['seed']}"
        (kept,) = (out / "kept" / case).glob("*/*/frames.jsonl")
        status, said = run("score", out / "runs" / case / "fine/repeat-1", kept.parent, "--json")
        assert status == 0
        expected = float(row["ate_rmse_m"]) if row["ate_rmse_m"] else None
        assert json.loads(said)["values"]["ate_rmse_m"] == pytest.approx(expected, abs=1e-12), row


SEARCHED = [
    ("all", "drift", ()),
    ("all", "rolling_shutter", ()),
    ("all", "frost", ("--parameter", "influence", "--with", "mode=keyed", "--with", "levels=[1, 3]")),
    ("all", "depth_gaussian_noise", ("--with", "temporal=fixed")),
    ("all", "desync", ("--from", "1", "--to", "2", "--with", "mode=dynamic")),
    ("rig", "speckle_noise", ()),
]


@pytest.mark.parametrize(("name", "perturbation", "words"), SEARCHED, ids=[item[1] for item in SEARCHED])
def test_a_threshold_is_searched_along_each_kind(worlds, tmp_path, monkeypatch, name, perturbation, words):  # noqa: PLR0917 - fixtures
    """One run, and the search is taken up for a second."""
    monkeypatch.setattr("noisy_world.evaluate.thresholds.drawn", lambda found: Picture("", "", "", b""))
    words = ("--perturbation", perturbation, *words, "--out", tmp_path / "out")
    for most in (1, 2):
        system = ("--system", worlds / "systems/fine.yaml", "--most", most)
        assert run("threshold", worlds / name / "preset.yaml", *system, *words)[0] == 0
    (file,) = tmp_path.glob("out/*/fine.threshold.json")
    assert [trial["outcome"] for trial in json.loads(file.read_text())["trials"]] == ["finished"] * 2
