# SPDX-License-Identifier: GPL-3.0-or-later
"""What `import noisy_world` gives: names that load when they are used, and examples that do what they show."""

import doctest
import subprocess
import sys

import numpy as np
import pytest
from refusals import refused
from worlds import ROOT

import noisy_world
import noisy_world.perturb
from noisy_world.core.packages import package_version
from noisy_world.perturbations import registry


def test_importing_the_package_is_cheap_and_its_parts_load_when_they_are_used():
    code = f"""
import sys
sys.path.insert(0, {str(ROOT / "addon")!r})
import noisy_world
assert not {{"bpy", "cv2", "numpy", "yaml"}} & set(sys.modules), set(sys.modules)
assert noisy_world.perturb.names()[0]
assert "bpy" not in sys.modules
print(sorted(name for name in dir(noisy_world)), noisy_world.__version__)
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    named = ["__version__", "extend", "open", "perturb", "register", "unregister"]
    assert told == f"{named} {package_version()}\n"


def test_under_another_name_its_parts_are_the_same_modules(tmp_path):
    # As Blender loads the extension; see other_name.py.
    (tmp_path / "repository").mkdir()
    (tmp_path / "repository/noisy_world").symlink_to(ROOT / "addon/noisy_world")
    code = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
import repository.noisy_world
from repository.noisy_world.other_name import give_other_name
give_other_name("noisy_world", "repository.noisy_world")
import noisy_world
assert noisy_world.perturb.__name__ == "repository.noisy_world.perturb"
import noisy_world.perturb as again
assert again is repository.noisy_world.perturb
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_names_that_there_are_not():
    with pytest.raises(AttributeError, match="module 'noisy_world' has no attribute 'pertrub'"):
        _ = noisy_world.pertrub


def test_perturbations_are_listed():
    assert noisy_world.perturb.names("all") == list(registry())
    assert {"apply", "frames", "names"} <= set(dir(noisy_world.perturb))


def test_a_severity_may_stand_after_the_name():
    rgb = np.random.default_rng(1).integers(0, 256, (9, 7, 3), np.uint8)
    apply = noisy_world.perturb.apply
    assert np.array_equal(apply(rgb, "contrast", 3), apply(rgb, "contrast", severity=3))
    assert not np.array_equal(apply(rgb, "contrast", 3), apply(rgb, "contrast", 1))
    assert np.array_equal(apply(rgb, "contrast", 0), rgb)


def test_examples_in_docstrings_do_what_they_show():
    done = doctest.testmod(noisy_world.perturb)
    assert done.attempted >= 7
    assert done.failed == 0


def test_a_place_that_is_not_there(tmp_path):
    (tmp_path / "out/kitchen").mkdir(parents=True)
    refused(noisy_world.open, tmp_path / "out/kitchn", names=["kitchn: ", "out/kitchen'?"])
    refused(noisy_world.open, tmp_path / "otu/kitchen", names=["otu/kitchen: ", "/out'?"])
    refused(noisy_world.open, tmp_path / "qqqq", names="qqqq: ")
