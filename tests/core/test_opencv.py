# SPDX-License-Identifier: GPL-3.0-or-later
"""An OpenCV that is too old is one line at the start, which names the package that brought it and its remedy."""

import shlex
import sys
from types import SimpleNamespace

import pytest

from noisy_world.cli.entry import Entry
from noisy_world.cli.entry import missing_package
from noisy_world.core.errors import MissingDependencyError
from noisy_world.core.packages import old_opencv
from noisy_world.perturbations import registry


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """A folder of packages in front of all others, in which an OpenCV may lie; nothing is imported yet."""
    monkeypatch.setitem(sys.modules, "cv2", None)  # so that what the test imports is taken away again
    monkeypatch.delitem(sys.modules, "cv2")
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def put(packages, version, distribution):
    """An OpenCV as pip leaves it; it cannot be imported."""
    (packages / "cv2").mkdir(exist_ok=True)
    (packages / "cv2/__init__.py").write_text("raise AssertionError('imported')\n")
    (packages / "cv2/version.py").write_text(f'opencv_version = "{version}"\ncontrib = False\n')
    about = packages / f"{distribution.replace('-', '_')}-{version}.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: {version}\n")


@pytest.mark.parametrize("distribution", ["opencv-python-headless", "opencv-python"])
def test_an_older_one_in_the_same_folder_is_named_with_its_remedy(packages, distribution):
    put(packages, "4.10.0.84", distribution)
    line = missing_package(["numpy", "cv2"], Entry("noisy-world", ("noisy-world",)))
    assert line.isprintable()
    assert "4.10.0.84" in line
    uninstall, run = line.split("; ")[1].split(", then run: ")
    assert distribution in uninstall
    words = shlex.split(run)
    assert words[0] == sys.executable
    assert words[-1] == "opencv-contrib-python-headless>=5.0"
    assert "--force-reinstall" in words
    with pytest.raises(MissingDependencyError) as caught:
        registry.__wrapped__()
    assert caught.value.message == line
    assert missing_package(["numpy"], Entry("noisy-world", ("noisy-world",))) == ""


def test_another_that_is_new_enough_serves(packages):
    put(packages, "5.0.0.93", "opencv-python")
    assert old_opencv() == ""


def test_one_that_no_package_tells_of_says_its_version_itself(packages, monkeypatch):
    (packages / "cv2.py").write_text("__version__ = '4.6.0-dev'\n")
    assert "OpenCV is 4.6.0" in old_opencv()
    monkeypatch.setitem(sys.modules, "cv2", SimpleNamespace(__version__="5.1.0"))
    assert old_opencv() == ""
    monkeypatch.setitem(sys.modules, "cv2", None)  # forbidden, as where it is missing
    assert old_opencv() == ""
