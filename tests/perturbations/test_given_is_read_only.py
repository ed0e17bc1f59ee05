# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations of a package that write into what they are given: a line names them, and no other frame changes."""

import sys

import cv2
import installed_package
import numpy as np
import pytest
from packed import write_preset
from worlds import write_world
from runs import run

from noisy_world.core.errors import NoisyWorldError
from noisy_world.perturbations import registry

NAME, VERSION = "rude-effects", "1.3"
HEAD = '''
from dataclasses import dataclass

import cv2
import numpy as np

from noisy_world.extend import *
from noisy_world.extend import ColourPerturbation, DepthPerturbation, ExposurePerturbation, MotionPerturbation, Shutter


@dataclass(frozen=True)
class Nothing:
    """Takes nothing."""
'''
COLOUR = """
PERTURBATION = ColourPerturbation(
    name="{name}", label="{name}", stage="lens", order=5, parameters=Nothing, severities={{}}, source="none",
    apply=apply{more},
)
"""
MODULES = {
    "in_numpy": "def apply(rgb, parameters, context):\n    rgb *= np.float32(0.5)\n    return rgb\n"
    + COLOUR.format(name="in_numpy", more=""),
    "in_opencv": "def apply(rgb, parameters, context):\n    return cv2.circle(rgb, (4, 4), 3, (1.0, 0.0, 0.0), -1)\n"
    + COLOUR.format(name="in_opencv", more=""),
    "in_bytes": "def apply(rgb, parameters, context):\n    return rgb\n\n\n"
    "def apply_bytes(rgb, parameters, context):\n    rgb[:] = 0\n    return rgb\n"
    + COLOUR.format(name="in_bytes", more=", apply_bytes=apply_bytes"),
    "in_depth": "def apply(depth_m, parameters, context):\n    depth_m[2:] = 0\n    return depth_m\n"
    "PERTURBATION = DepthPerturbation(\n    name='in_depth', label='In depth', order=5, parameters=Nothing,"
    " severities={}, source='none', apply=apply,\n)\n",
    "in_colour_of_depth": "def apply(depth_m, parameters, context):\n    context.rgb[:] = 0\n    return depth_m\n"
    "PERTURBATION = DepthPerturbation(\n    name='in_colour_of_depth', label='In colour', order=5, parameters=Nothing,"
    " severities={}, source='none', apply=apply, needs_rgb=True,\n)\n",
    "in_path": "def apply(trajectory, parameters, context):\n    trajectory.c2w[:, 2, 3] += 1\n    return trajectory\n"
    "PERTURBATION = MotionPerturbation(\n    name='in_path', label='In path', order=5, parameters=Nothing,"
    " severities={}, source='none', apply=apply,\n)\n",
    "in_exposure": "def apply(around, parameters):\n    rgb = around(0.0).rgb\n    rgb[:] = 0\n    return rgb, None\n"
    "PERTURBATION = ExposurePerturbation(\n    name='in_exposure', label='In exposure', order=5, parameters=Nothing,"
    " severities={}, source='none', apply=apply, shutter=lambda parameters: Shutter(),\n)\n",
    "echo": "def apply(rgb, parameters, context):\n    return rgb\n" + COLOUR.format(name="echo", more=""),
}
RENDERED = ("in_path", "in_exposure")  # not of recordings
RUDE = [name for name in MODULES if name != "echo"]
RAYS = {"engine": "embree", "backend": "reference"}
NOISE = {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}, {"depth_gaussian_noise": {"severity": 2}}]}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    modules = {"__init__.py": "", **{f"{name}.py": HEAD + "\n\n" + text for name, text in MODULES.items()}}
    entry_points = {name: f"rude_effects.{name}:PERTURBATION" for name in MODULES}
    return installed_package.install(tmp_path_factory.mktemp("site"), NAME, VERSION, entry_points, modules)


@pytest.fixture
def installed(site, monkeypatch):
    monkeypatch.syspath_prepend(str(site))
    registry.cache_clear()
    yield
    registry.cache_clear()
    for name in [item for item in sys.modules if item.partition(".")[0] == "rude_effects"]:
        del sys.modules[name]


def images(folder):
    return {path.name: cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted(folder.rglob("*.png"))}


def dataset(folder, *settings):
    run(write_preset(folder, frames=2, scenes=("hall",), settings=[{"name": "clean"}, *settings]), folder / "out")
    return folder / "out"


@pytest.mark.parametrize("name", RUDE)
def test_what_writes_into_its_input_is_named(installed, tmp_path, name):
    rude = {"name": "rude", "perturb": [{name: {}}]}
    if name in RENDERED:
        pytest.importorskip("embreex", reason="embreex comes with an extra")
        preset = write_world(tmp_path, frames=2, size=(8, 6), settings=[rude], render=RAYS)
    else:
        preset = write_preset(tmp_path, frames=2, scenes=("hall",), settings=[rude, NOISE])
    with pytest.raises(NoisyWorldError, match=f"^{name} of {NAME} {VERSION}: writes into what it is given"):
        run(preset, tmp_path / "out")


def test_what_returns_its_input_changes_no_other_frame(installed, tmp_path):
    """After it a step of light clips nothing in place, and the clean images are those of a run without it."""
    echoed = {"name": "echoed", "perturb": [{"echo": {}}, {"gaussian_noise": {"severity": 3}}], "stream": "noise"}
    out, alone = dataset(tmp_path / "with", echoed, NOISE), dataset(tmp_path / "alone", NOISE)
    for setting in ("clean", "noise"):
        found, expected = images(out / setting), images(alone / setting)
        assert found.keys() == expected.keys()
        assert len(found) == 4
        assert all(np.array_equal(found[key], expected[key]) for key in found)
    colour = {key: image for key, image in images(out / "echoed").items() if key.startswith("frame")}
    assert all(np.array_equal(image, images(alone / "noise")[key]) for key, image in colour.items())
