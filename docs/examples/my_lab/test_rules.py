# SPDX-License-Identifier: GPL-3.0-or-later
from pathlib import Path

import my_lab.corridor
import my_lab.facing
import my_lab.flat
import my_lab.odometer
import my_lab.phone
import my_lab.strays
import my_lab.upward

from noisy_world.testing import (
    check_channel,
    check_layout,
    check_map_metric,
    check_metric,
    check_source,
    check_system,
    check_trajectory_format,
)


def test_corridor(tmp_path):
    check_source(my_lab.corridor.SOURCE, {"corridor": {"width_m": 3}}, tmp_path)


def test_flat(tmp_path):
    check_layout(my_lab.flat.LAYOUT, tmp_path)


def test_phone():
    check_layout(my_lab.phone.LAYOUT, Path(__file__).parent / "a_recording")


def test_odometer(tmp_path):
    (file := tmp_path / "odometer.txt").write_text(
        "ms;x_m;y_m;heading_deg\n0;0.0;0.0;0.0\n50;0.01;0.0;1.5\n100;0.02;0.001;3.0\n"
    )
    check_trajectory_format(my_lab.odometer.FORMAT, file, tmp_path)


def test_facing():
    check_channel(my_lab.facing.CHANNEL)


def test_upward():
    check_metric(my_lab.upward.METRIC)


def test_strays():
    check_map_metric(my_lab.strays.METRIC)


def test_still(tmp_path):
    check_system(Path("my_lab/systems/still.yaml"), tmp_path)
