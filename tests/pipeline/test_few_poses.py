# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of one, two and three poses under all that looks between poses; a path of one pose stands still."""

import numpy as np
import pytest
from cases import cases
from worlds import write_world
from runs import run
from written import read, rows_of

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")

from noisy_world.perturbations.kinds import ExposurePerturbation, MotionPerturbation
from noisy_world.perturbations import registry

SHUTTERS = [
    {"rolling_shutter": {"readout_ms": 30, "stamp": stamp, "direction": direction, "depth": depth}}
    for stamp, direction, depth in (("start", "down", "rolling"), ("end", "left", "global"))
] + [{"camera_motion_blur": {"shutter_ms": 30, "stamp": stamp}} for stamp in ("start", "end")]
CLOCKS = {
    "none": None,
    "slow and drifting": {"delay_ms": -5, "rate_hz": 7, "clock_drift_ppm": -100},
    "registered": {"translation_m": [0.1, 0, 0], "registered": True, "delay_ms": 3},
}


def settings(clock):
    """Each motion and each shutter alone, and some of both; under a clock of depth, the latter."""
    kinds = registry().values()
    assert {item.name for item in kinds if isinstance(item, ExposurePerturbation)} <= {
        name for step in SHUTTERS for name in step
    }
    steps = [[{name: {}}, step] for name in ("faster_motion", "drift", "jerk") for step in SHUTTERS[::2]]
    if clock is None:
        steps += [[step] for step in SHUTTERS]
        steps += [[{item.name: {}}] for item in kinds if isinstance(item, MotionPerturbation)]
    return [{"name": "clean"}] + [{"name": f"s{number}", "perturb": each} for number, each in enumerate(steps)]


@cases(("count", "clock"), [*((count, "none") for count in (1, 2, 3)), *((1, clock) for clock in [*CLOCKS][1:])])
def test_a_short_path_takes_every_motion_shutter_and_clock(tmp_path, count, clock):
    folder = tmp_path / f"{count} {clock}"
    chosen = settings(CLOCKS[clock])
    rig = {} if CLOCKS[clock] is None else {"rig": {"depth": CLOCKS[clock]}}
    render = {"engine": "embree", "backend": "reference"}
    run(write_world(folder, frames=count, size=(8, 6), settings=chosen, render=render, **rig), folder / "out")
    clean = [read(path).astype(int) for path in sorted((folder / "out/clean/box/results").iterdir())]
    assert len(clean) == 2 * count
    for setting in chosen:
        names = {name for step in setting.get("perturb", []) for name in step}
        made = folder / "out" / setting["name"] / "box"
        poses = np.loadtxt(made / "traj.txt").reshape(-1, 4, 4)
        assert len(poses) == (-(-count // 2) if "faster_motion" in names else count)
        assert np.isfinite(poses).all()
        if count == 1 and not names & {"motion_deviation", "vibration", "drift", "jerk"}:
            found = [read(path).astype(int) for path in sorted((made / "results").iterdir())]
            for image, wanted in zip(found, clean, strict=True):
                assert np.abs(image - wanted).max() <= 1, names


@cases("count", [1, 2, 3])
@cases("layout", ["euroc"])
def test_an_imu_on_a_short_path(tmp_path, count, layout):
    rig = {"imu": {"device": "ideal", "rate_hz": 100, "clock_drift_ppm": 50, "time_offset_s": 0.1}}
    chosen = [{"name": "clean"}, {"name": "rolling", "perturb": [{"drift": {}}, SHUTTERS[0]]}]
    keys = {"settings": chosen, "output": {"layout": layout}, "render": {"engine": "embree", "backend": "reference"}}
    folder = tmp_path / f"{count} {layout}"
    run(write_world(folder, frames=count, size=(8, 6), rig=rig, **keys), folder / "out")
    for setting in ("clean", "rolling"):
        rows = np.array(rows_of(folder / "out" / setting / "box/mav0/imu0/data.csv"), dtype=np.float64)
        assert len(rows) >= 2
        assert np.isfinite(rows).all()
        if count == 1 and setting == "clean":  # a camera at rest feels gravity alone
            np.testing.assert_allclose(rows[:, 1:4], 0.0, atol=1e-9)
            np.testing.assert_allclose(np.linalg.norm(rows[:, 4:7], axis=1), 9.81, rtol=1e-7)
