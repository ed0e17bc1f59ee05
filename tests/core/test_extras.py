# SPDX-License-Identifier: GPL-3.0-or-later
"""The command that installs an extra names what the package came from, which may be on no index."""

import json
import shlex
import sys
import tomllib
from pathlib import Path

import pytest

from noisy_world.core import packages as dependencies
from noisy_world.core.errors import MissingDependencyError

CHECKOUT = Path(__file__).resolve().parents[2]
PIP = [sys.executable, "-m", "pip", "install"]


def test_the_extras_are_those_of_the_package():
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
    assert {name: list(brought) for name, brought in dependencies.EXTRAS.items()} == project["project"][
        "optional-dependencies"
    ]
    assert project["dependency-groups"]["evaluate"] == list(dependencies.EXTRAS["evaluate"]), (
        "what `make benchmark` installs"
    )
    assert set(project["dependency-groups"]["extras"]) >= {
        word for name, brought in dependencies.EXTRAS.items() if name != "blender" for word in brought
    }
    version = ".".join(map(str, dependencies.BLENDER_PYTHON))
    assert [f'python_version == "{version}"' in word for word in dependencies.EXTRAS["blender"]] == [True]


def test_a_checkout_is_named():
    assert shlex.split(dependencies.install_command("evaluate")) == [*PIP, f"{CHECKOUT}[evaluate]"]


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package in a folder of packages: a function that records where it came from."""
    packages = tmp_path / "site-packages"
    about = packages / "noisy_world-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.4\nName: noisy-world\nVersion: 1.0\n")
    monkeypatch.setattr(dependencies, "checkout", lambda: None)
    monkeypatch.syspath_prepend(packages)

    def record(given):
        (about / "direct_url.json").write_text(json.dumps(given))

    return record


def test_where_an_installed_package_came_from_is_named(installed, tmp_path):
    def words():
        return shlex.split(dependencies.install_command("cloud"))

    assert words() == [*PIP, "noisy-world[cloud]"], "it came from an index"
    folder = tmp_path / "noisy world"
    installed({"url": folder.as_uri(), "dir_info": {}})
    assert words() == [*PIP, *dependencies.EXTRAS["cloud"]], "the folder is gone"
    folder.mkdir()
    assert words() == [*PIP, f"{folder}[cloud]"]
    installed({"url": "https://example.org/noisy.git", "vcs_info": {"vcs": "git", "commit_id": "abc"}})
    assert words() == [*PIP, "noisy-world[cloud] @ git+https://example.org/noisy.git@abc"]
    installed({"url": "https://example.org/noisy.tar.gz", "archive_info": {}, "subdirectory": "sub"})
    assert words() == [*PIP, "noisy-world[cloud] @ https://example.org/noisy.tar.gz#subdirectory=sub"]


def test_an_extension_of_blender_names_the_packages(installed, monkeypatch):
    monkeypatch.setattr(dependencies, "DISTRIBUTION", "no-such-distribution")
    assert shlex.split(dependencies.install_command("embree")) == [*PIP, *dependencies.EXTRAS["embree"]]


def test_an_environment_without_pip_has_uv(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert shlex.split(dependencies.install_command("cloud"))[:5] == [
        "uv",
        "pip",
        "install",
        "--python",
        sys.executable,
    ]


def test_where_blender_is_missing_the_line_names_the_extra_and_its_python(monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", sys)
    assert dependencies.blender_missing() == ""
    monkeypatch.setitem(sys.modules, "bpy", None)
    monkeypatch.setattr(dependencies, "BLENDER_PYTHON", sys.version_info[:2])
    line = dependencies.blender_missing("a .blend", otherwise="do without")
    assert line.startswith("a .blend: bpy: missing in this Python 3.")
    assert line.endswith(f"; run: {dependencies.install_command('blender')}, or do without")
    monkeypatch.setattr(dependencies, "BLENDER_PYTHON", (3, 99))
    python, command = (
        dependencies.blender_missing().split("the extra blender, which brings it, is for ")[1].split(" run: ")
    )
    assert python == "Python 3.99 alone: in an environment of that"
    assert shlex.split(command) == ["python3.99", "-m", "pip", "install", f"{CHECKOUT}[blender]"]


def test_what_is_missing_is_one_line_with_the_command():
    dependencies.need(["json"], "cloud")
    with pytest.raises(MissingDependencyError) as caught:
        dependencies.need(["json", "no_such_module"], "embree", for_what="casting rays", otherwise="do without")
    line = str(caught.value)
    assert line.startswith("casting rays: no_such_module: missing in this Python 3.")
    assert line.endswith(f"; run: {dependencies.install_command('embree')}, or do without")


@pytest.mark.parametrize("version", [(3, 11), (3, 14)])
@pytest.mark.parametrize(
    ("system", "machine"),
    [("linux", "x86_64"), ("linux", "aarch64"), ("darwin", "x86_64"), ("darwin", "arm64"), ("win32", "AMD64")],
)
def test_what_no_package_brings_to_a_machine_is_said_instead_of_a_command(monkeypatch, system, machine, version):
    """As the markers of pyproject.toml have it, which leave the same packages out."""
    markers = pytest.importorskip("packaging.markers")
    requirements = pytest.importorskip("packaging.requirements")
    here = {"sys_platform": system, "platform_machine": machine, "python_version": ".".join(map(str, version))}
    full = markers.default_environment() | here
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr(sys, "version_info", (*version, 0, "final", 0))
    for word in dependencies.EXTRAS["evaluate"]:
        found = requirements.Requirement(word)
        left_out = found.marker is not None and not found.marker.evaluate(full)
        assert bool(dependencies.unavailable(found.name)) == left_out, (found.name, here)
    monkeypatch.setattr(dependencies, "missing_packages", list)
    for module in ("gtsam", "embreex", "numba"):
        if where := dependencies.unavailable(module):
            with pytest.raises(MissingDependencyError) as caught:
                dependencies.need([module], "evaluate", for_what="closing loops", otherwise="leave them open")
            line = str(caught.value)
            assert f"{module} has no package for {where}" in line
            assert "install" not in line
            assert line.endswith("leave them open")
