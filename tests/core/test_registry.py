# SPDX-License-Identifier: GPL-3.0-or-later
"""A registry's own things lie in files, each imported when its name is asked for."""

import sys
from dataclasses import dataclass

import pytest

from noisy_world.channels import CHANNELS
from noisy_world.cli.command import COMMANDS
from noisy_world.core import packages
from noisy_world.core.packages import Door, Registry
from noisy_world.evaluate.map_metrics import MAP_METRICS
from noisy_world.evaluate.metrics import METRICS
from noisy_world.layouts import EVERY
from noisy_world.perturbations import registry
from noisy_world.preset.camera_devices import CAMERA_DEVICES
from noisy_world.sources import SOURCES
from noisy_world.trajectories.formats import TRAJECTORY_FORMATS

FILES = {
    "late": 'THING = Thing(name="late", order=30)',
    "two": 'ONE = Thing("first", 10)\nTHING = ONE, Thing(\n    name="second",\n    order=20)',
    "other": 'NAME = "stray"\nBESIDE = Thing("beside", 1)',
    "_hidden": 'THING = Thing("hidden", 5)',
}


@dataclass(frozen=True)
class Thing:
    name: str
    order: int = 0


@pytest.fixture
def things(tmp_path, monkeypatch):
    """Return a registry of things in files of a package, and what of them has been imported."""
    folder = tmp_path / "shelf"
    folder.mkdir()
    for name, text in FILES.items():
        (folder / f"{name}.py").write_text(f"from {__name__} import Thing\n{text}\n")
    (folder / "__init__.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(sys.modules, __name__, sys.modules[Thing.__module__])
    yield (
        Registry(Door("nobody.things", "thing", "THING", (Thing,)), "shelf", listed=[Thing("listed", 99)]),
        lambda: sorted(name.removeprefix("shelf.") for name in sys.modules if name.startswith("shelf.")),
    )
    for name in [name for name in sys.modules if name.split(".")[0] == "shelf"]:
        del sys.modules[name]


def test_a_name_imports_its_file_alone(things):
    found, imported = things
    assert (found["listed"].order, imported()) == (99, [])
    assert (found["second"].order, imported()) == (20, ["two"])
    assert (found["late"].order, imported()) == (30, ["late", "two"])


@pytest.mark.parametrize("name", ["stray", "hidden", "beside", "nothing", "../late", "two", "_hidden", "a\0b", 7, None])
def test_what_is_no_thing_is_not_found(things, name):
    found, _ = things
    assert name not in found
    with pytest.raises(KeyError):
        found[name]


def test_all_are_listed_in_their_order(things):
    found, _ = things
    assert list(found) == ["listed", "first", "second", "late"]
    assert found.distribution("first") is None


def test_a_name_that_its_file_does_not_say_is_a_bug(things, tmp_path):
    found, _ = things
    (tmp_path / "shelf/strange.py").write_text(f'from {__name__} import Thing\nTHING = Thing("o" + "dd")\n')
    with pytest.raises(AssertionError, match="odd is not found by its name"):
        list(found)


@pytest.mark.parametrize(
    "all_of_them",
    [CAMERA_DEVICES, CHANNELS, COMMANDS, EVERY, MAP_METRICS, METRICS, SOURCES, TRAJECTORY_FORMATS, registry()],
)
def test_all_that_are_listed_are_found_by_name(all_of_them):
    for name, item in all_of_them.items():
        assert all_of_them.ours(name) is item
        assert all_of_them.get(name) is item


def test_those_of_one_class_alone_are_found_by_name(things):
    found, _ = things

    class Special(Thing):
        pass

    assert found.only(Thing)["listed"] is found["listed"]
    with pytest.raises(KeyError, match="listed"):
        found.only(Special)["listed"]
    assert list(found.only(Thing)) == list(found)
    assert len(found.only(Special)) == 0
    assert found.origin("late") == ""


def test_what_is_shipped_and_the_version_are_looked_for_at_the_package(tmp_path, monkeypatch):
    package = tmp_path / "addon/noisy_world"
    package.mkdir(parents=True)
    monkeypatch.setattr(packages, "PACKAGE", package)
    with pytest.raises(RuntimeError, match="no presets at "):
        packages.shipped("presets")
    with pytest.raises(RuntimeError, match=r"no blender_manifest\.toml with a version"):
        packages.package_version()
    assert packages.checkout() is None
    (package / "blender_manifest.toml").write_text('id = "noisy_world"\n')
    (tmp_path / "blender_manifest.toml").write_text('version = "9.8.7"\n')
    (tmp_path / "presets").mkdir()
    assert packages.package_version() == "9.8.7"  # the nearer file says none
    assert packages.shipped("presets") == tmp_path / "presets"
