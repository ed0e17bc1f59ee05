# SPDX-License-Identifier: GPL-3.0-or-later
"""Plans whose frames take more memory than there is are refused before anything is made."""

import cv2
import numpy as np
import pytest
from worlds import write_world
from runs import run

from noisy_world.cli.command import main
from noisy_world.core.errors import OutOfMemoryError, memory_errors
from noisy_world.dataset import estimate
from noisy_world.dataset.estimate import check_memory, memory_bytes
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan

COLOUR_AND_DEPTH = 3 * 4 + 4  # bytes of a pixel, as float32


def plan_of(folder, *overrides, size=(64, 48)):
    return make_plan(read_preset(write_world(folder, frames=2, size=size), overrides))


def test_what_a_plan_takes_grows_with_its_pixels_and_with_what_is_done_to_them(tmp_path):
    plain = "settings=[{name: clean}]"
    noisy = "settings=[{name: n, perturb: [{gaussian_noise: {severity: 3}}]}]"
    small = memory_bytes(plan_of(tmp_path, plain, "render.engine=embree"))
    wide = ("camera.width=20000", "camera.height=20000", "camera.fx=10000", "camera.fy=10000")
    large = memory_bytes(plan_of(tmp_path, plain, "render.engine=embree", *wide))
    assert large - small >= COLOUR_AND_DEPTH * (20_000**2 - 64 * 48)
    assert memory_bytes(plan_of(tmp_path, noisy, "render.engine=embree", *wide)) > large
    assert memory_bytes(plan_of(tmp_path, plain, "render.engine=cycles", *wide)) > large


def test_a_plan_beyond_what_is_there_names_its_key_and_makes_nothing(tmp_path, monkeypatch, capsys):
    preset = write_world(tmp_path, frames=2, render={"engine": "embree", "backend": "reference"})
    needed = memory_bytes(make_plan(read_preset(preset)))
    monkeypatch.setattr(estimate, "held_memory_bytes", lambda: 0)
    monkeypatch.setattr(estimate, "free_memory_bytes", lambda: needed - 1)
    assert main(["generate", str(preset), "--dry-run"]) == 1
    assert f"{preset}: camera: " in capsys.readouterr().err
    with pytest.raises(OutOfMemoryError):
        run(preset, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(estimate, "free_memory_bytes", lambda: 2 * needed)
    check_memory(make_plan(read_preset(preset)), 2)
    with pytest.raises(OutOfMemoryError, match="jobs"):
        check_memory(make_plan(read_preset(preset)), 3)
    monkeypatch.setattr(estimate, "free_memory_bytes", lambda: None)
    check_memory(make_plan(read_preset(preset)))  # a system that does not tell refuses nothing


def asked_of_numpy():
    np.empty(2**60, np.uint8)


def asked_of_a_thread():
    raise RuntimeError("can't start new thread")  # so Python says it, word by word


@pytest.mark.parametrize("work", [asked_of_numpy, asked_of_a_thread])
def test_want_of_memory_is_a_line(work):
    with pytest.raises(OutOfMemoryError, match="more memory"), memory_errors():
        work()


@pytest.mark.parametrize("bug", [RuntimeError("another"), cv2.error("another"), IndexError()])
def test_other_errors_keep_their_tracebacks(bug):
    with pytest.raises(type(bug)), memory_errors():
        raise bug
