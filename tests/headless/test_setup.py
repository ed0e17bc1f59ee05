# SPDX-License-Identifier: GPL-3.0-or-later
"""What sets a machine up: missing libraries are named by their packages, and the lock is what it should be."""

import re
import subprocess
import sys

import pytest
from worlds import ROOT

from noisy_world.cli import system_libraries

sys.path.append(str(ROOT / "headless"))
from tools import blender_env


LDD = """\tlinux-vdso.so.1 (0x00007ffc)
\tlibX11.so.6 => not found
\tlibc.so.6 => /lib/x86_64-linux-gnu/libc.so.6 (0x00007f)
\tlibGL.so.1 => not found
\tlibX11.so.6 => not found
\tlibodd.so.9 => not found
"""


def test_missing_libraries_become_debian_packages():
    names = system_libraries.parse_ldd(LDD)
    assert names == ["libGL.so.1", "libX11.so.6", "libodd.so.9"]
    assert system_libraries.debian_packages(names) == ["libgl1", "libodd.so.9", "libx11-6"]
    line = system_libraries.advice(names)
    assert "\n" not in line
    assert "apt-get install libgl1 libodd.so.9 libx11-6" in line


def test_here_nothing_is_missing():
    pytest.importorskip("bpy", reason="bpy is not installed")
    assert system_libraries.missing_libraries() == []


def test_the_lock_pins_hashes_and_names_no_address():
    text = (ROOT / "requirements.lock").read_text()
    assert not re.search(r"https?:|index-url", text)
    entries = text.replace("\\\n", " ").splitlines()
    pinned = [entry for entry in entries if "==" in entry]
    assert len(pinned) > 10
    assert all("--hash=sha256:" in entry for entry in pinned)
    chosen = blender_env.pinned_requirements(text)
    assert len(chosen.splitlines()) == 4
    assert "numpy" not in chosen  # Blender's own


def test_a_blender_that_is_not_there_is_one_line():
    command = [sys.executable, ROOT / "headless/tools/blender_env.py", "/nowhere/blender"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert "BLENDER=/path/to/blender" in result.stderr


def test_manifest_and_package_agree_on_the_version():
    from noisy_world.core.datasets.provenance import package_version

    assert f'version = "{package_version()}"' in (ROOT / "blender_manifest.toml").read_text()
    assert f"## {package_version()}" in (ROOT / "CHANGELOG.md").read_text()
