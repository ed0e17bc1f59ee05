# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets made of frames from arithmetic, with their recipes and clean frames; one of thirty settings and more."""

import contextlib
import signal
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

import fake_session
import pytest
from runs import run
from worlds import write_world

from noisy_world.cli import command
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.clean_store import make_store
from noisy_world.dataset.remaking import plan_of
from noisy_world.dataset.recipe import recipe_of
from noisy_world.dataset.recipe import read_recipe

COUNT = 9
SIZE = (40, 32)
COLOUR = ["gaussian_noise", "shot_noise", "impulse_noise", "speckle_noise"]
COLOUR += ["defocus_blur", "glass_blur", "motion_blur", "gaussian_blur", "snow", "frost", "fog", "spatter"]
COLOUR += ["brightness", "contrast", "pixelate", "jpeg_compression"]
DEPTH = ["depth_gaussian_noise", "depth_edge_erosion", "depth_random_missing", "depth_range_clipping"]
MIXED = [
    {"desync": {"offset": 2}},
    {"depth_random_missing": {"severity": 3}},
    {"jpeg_compression": {"severity": 2}},
    {"gaussian_noise": {"severity": 1, "mode": "dynamic"}},
    {"faster_motion": {"factor": 2}},
]
SETTINGS = [
    {"name": "clean"},
    {"sweep": {"perturb": COLOUR, "severities": [3]}},
    {"sweep": {"perturb": DEPTH, "severities": [3]}},
    {"name": "fog_dynamic", "perturb": [{"fog": {"severity": 5, "mode": "dynamic"}}]},
    {"name": "drift", "perturb": [{"spatter": {"severity": 4, "temporal": "drift"}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 3}}]},
    {"name": "early", "perturb": [{"desync": {"offset": -2, "edge": "drop"}}]},
    {"name": "adrift", "perturb": [{"desync": {"offset": 4, "mode": "dynamic"}}]},
    {"name": "fast", "perturb": [{"faster_motion": {"factor": 3}}]},
    {"name": "shaky", "perturb": [{"motion_deviation": {"rotation_deg": 3, "translation_m": 0.05}}]},
    {"name": "mixed", "perturb": MIXED},
    {"name": "shaky_mixed", "perturb": [{"motion_deviation": {"rotation_deg": 1, "translation_m": 0.02}}, *MIXED]},
]


@dataclass(frozen=True)
class Made:
    """A dataset, its recipe beside its inputs, and its clean frames."""

    out: Path
    recipe: Path
    clean: Path


@contextlib.contextmanager
def frames_from_arithmetic():
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
        yield


def progress():
    return PlainProgress(sys.stderr)


def make(folder, *, clean=True, **keys):
    """Make a dataset, its recipe and its clean frames."""
    preset = write_world(folder / "world", **{"frames": COUNT, "size": SIZE, "settings": SETTINGS, **keys})
    run(preset, folder / "out")
    recipe = folder / "world/recipe.json"
    recipe.write_text(recipe_of(folder / "out", progress()).text())
    if clean:
        make_store(plan_of(read_recipe(recipe)), folder / "clean", progress(), threading.Event())
    return Made(folder / "out", recipe, folder / "clean")


def noisy_world(*words):
    """Run the command in this process and return its status."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        return command.main([str(word) for word in words])
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
