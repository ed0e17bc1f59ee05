# SPDX-License-Identifier: GPL-3.0-or-later
"""What is missing is named as it is installed, with a remedy for where it is missing."""

import sys

from noisy_world.core.packages import install_remedy, missing_packages, missing_sentence


def test_what_cannot_be_imported_is_named_as_it_is_installed(monkeypatch):
    assert missing_packages(["numpy", "json"]) == []
    for module in ("cv2", "yaml", "no_such_module"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert missing_packages(["numpy", "cv2", "yaml", "no_such_module"]) == [
        "opencv-contrib-python-headless", "pyyaml", "no_such_module",
    ]  # fmt: skip


def test_one_line_says_what_is_missing_where_and_what_to_do():
    version = ".".join(map(str, sys.version_info[:2]))
    text = missing_sentence(["pyyaml", "tqdm"], "this Blender's ", "run: make venv")
    assert text == f"pyyaml, tqdm: missing in this Blender's Python {version} on {sys.platform}; run: make venv"
    assert f"missing in this Python {version}" in missing_sentence(["tqdm"], "", "x")


def test_the_zip_that_is_installed_is_told_from_the_one_that_is_needed(tmp_path):
    assert "make extension" in install_remedy(tmp_path)
    (tmp_path / "wheels").mkdir()
    for name in ("openexr-3.5-cp313-cp313-win_amd64.whl", "openexr-3.5-cp314-cp314-win_amd64.whl"):
        (tmp_path / "wheels" / name).touch()
    remedy = install_remedy(tmp_path)
    assert "win_amd64" in remedy
    assert "3.13 and 3.14" in remedy
