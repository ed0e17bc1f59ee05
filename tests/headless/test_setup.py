# SPDX-License-Identifier: GPL-3.0-or-later
"""What sets a machine up: missing libraries are named by their packages, and the lock is what it should be."""

import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

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
    of_orb_slam3 = system_libraries.advice(["libGLU.so.1", "libOpenGL.so.0"], "orb_slam3")
    assert of_orb_slam3.startswith("orb_slam3 needs system libraries")
    assert of_orb_slam3.endswith("run: apt-get install libglu1-mesa libopengl0")
    line = system_libraries.advice(names)
    assert "\n" not in line
    assert "apt-get install libgl1 libodd.so.9 libx11-6" in line


def test_here_nothing_is_missing():
    pytest.importorskip("bpy", reason="bpy is not installed")
    assert system_libraries.missing_libraries() == []


def test_what_bpy_needs_of_the_system_is_known_before_it_is_installed():
    spec = importlib.util.find_spec("bpy")
    if spec is None or not sys.platform.startswith("linux"):
        pytest.skip("bpy is not installed, or is not linked as on Linux")
    own = Path(spec.origin).with_name("__init__.so")
    said = subprocess.run(["ldd", own], capture_output=True, text=True, check=True).stdout
    linked = dict(re.findall(r"^\s*(\S+) => (/\S+)", said, re.MULTILINE))
    of_the_system = {name for name, path in linked.items() if not Path(path).is_relative_to(own.parent)}
    assert set(system_libraries.OF_BPY) == of_the_system & set(system_libraries.DEBIAN_PACKAGES)


def test_the_lock_pins_hashes_and_names_no_address():
    text = (ROOT / "requirements/base.lock").read_text()
    assert not re.search(r"https?:|index-url", text)
    entries = text.replace("\\\n", " ").splitlines()
    pinned = [entry for entry in entries if "==" in entry]
    assert len(pinned) > 10
    assert all("--hash=sha256:" in entry for entry in pinned)
    chosen = blender_env.pinned_requirements(text)
    assert len(chosen.splitlines()) == len(blender_env.PACKAGES)
    assert "numpy" not in chosen  # Blender's own


def test_a_blender_that_is_not_there_is_one_line():
    command = [sys.executable, ROOT / "headless/tools/blender_env.py", "/nowhere/blender"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert "BLENDER=/path/to/blender" in result.stderr


def test_manifest_and_package_agree_on_the_version():
    from noisy_world.core.packages import package_version

    assert f'version = "{package_version()}"' in (ROOT / "blender_manifest.toml").read_text()
    assert f"## {package_version()}" in (ROOT / "CHANGELOG.md").read_text()


# --- the environments that make sets up ---

# What Debian's Python says without the package python3.13-venv, and the half of an environment that it leaves.
DEBIANS = """#!/bin/sh
case "$*" in
  "-m venv "*)
    mkdir -p "$3/bin" && ln -s {python} "$3/bin/python" && : >"$3/pyvenv.cfg"
    echo "The virtual environment was not created successfully because ensurepip is not"
    echo "available.  On Debian/Ubuntu systems, you need to install the python3-venv"
    echo "package using the following command."
    echo; echo "    apt install python3.13-venv"; echo; echo "Failing command: $3/bin/python3.13"; echo
    exit 1 ;;
  *sys.executable*) echo "$0" ;;
  *) exec {python} "$@" ;;
esac
"""
# One that makes environments with a pip of our own, which installs by writing a file, as slowly or badly as is said.
WORKING = """#!/bin/sh
case "$*" in
  "-m venv "*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" && echo venv >>"{log}" ;;
  *"-m pip install"*)
    touch "$(dirname "$0")/../half"; cat "$(dirname "$0")/../../said" 2>/dev/null
    sleep "${{SLOW:-0}}"; [ -z "${{BROKEN:-}}" ] || {{ echo "ERROR: No matching distribution" >&2; exit 1; }}
    echo "$*" >>"{log}"; mv "$(dirname "$0")/../half" "$(dirname "$0")/../whole" ;;
  *"import pip"*) [ -e "$(dirname "$0")/../" ] ;;
  *sys.executable*) echo "$0" ;;
  *) exec {python} "$@" ;;
esac
"""


@pytest.fixture
def checkout(tmp_path):
    """A folder with the Makefile and what its environments are made from."""
    for name in ("Makefile", "requirements/base.lock", "requirements/docs.lock", "headless/tools/environment.sh"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / "tests/peer").mkdir(parents=True)
    for name in ("requirements.txt", "corruptions.txt"):
        (tmp_path / "tests/peer" / name).write_text("")
    package = tmp_path / "addon/noisy_world/cli"
    package.mkdir(parents=True)
    for folder in (package, package.parent):
        (folder / "__init__.py").touch()
    (package / "system_libraries.py").touch()
    return tmp_path


def put(checkout, text, *names):
    for name in names:
        path = checkout / "path" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text.format(python=sys.executable, log=checkout / "log"))
        path.chmod(0o755)


def make(checkout, *words, **variables):
    environment = {"PATH": f"{checkout / 'path'}:/usr/bin:/bin", "HOME": str(checkout), **variables}
    return subprocess.Popen(
        ["make", *words], cwd=checkout, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip


def made(checkout, *words, **variables):
    process = make(checkout, *words, **variables)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


@pytest.mark.parametrize(
    ("target", "folder", "python"),
    [("venv", ".venv", "python3.13"), (".venv-docs/.installed", ".venv-docs", "python3.13"),
     ("peer-env", ".venv-peer", "python3.11"), ("corruptions-env", ".venv-corruptions", "python3.11")],
)  # fmt: skip
def test_a_python_without_venv_is_one_line_and_leaves_nothing(checkout, target, folder, python):
    put(checkout, DEBIANS, "python3.13", "python3.11")
    status, out, err = made(checkout, target)
    assert status != 0
    ours = [line for line in err.splitlines() if not line.startswith("make: ***")]
    assert len(ours) == 1, err
    assert f"{checkout}/path/{python} cannot make {folder}" in ours[0]
    assert "install Debian's python3.13-venv, or say PYTHON" in ours[0]  # both are this Python, by their version
    assert "ensurepip" not in out
    assert not (checkout / folder).exists()


def test_missing_libraries_are_told_before_anything_is_downloaded(checkout):
    put(checkout, WORKING, "python3.13")
    (checkout / "addon/noisy_world/cli/system_libraries.py").write_text("raise SystemExit('bpy needs libGL.so.1')\n")
    status, _, err = made(checkout, "venv")
    assert status != 0
    assert "bpy needs libGL.so.1" in err
    assert not (checkout / ".venv").exists()


def test_what_is_downloaded_is_told_with_its_size_and_how_far_it_is(checkout):
    put(checkout, WORKING, "python3.13")
    (checkout / "requirements/base.lock").write_text(
        "bpy==5.2.3 \\\n    --hash=sha256:00\nnumpy==2.5.5 \\\n    --hash=sha256:00\n"
    )
    (checkout / "said").write_text(
        "Collecting bpy==5.2.3 (from -r requirements/base.lock (line 1))\n"
        "  Downloading bpy-5.2.3-cp313.whl (402.8 MB)\n"
        + "".join(f"Progress {k}00000000 of 400000000\n" for k in range(5))
        + "Collecting numpy==2.5.5\n  Using cached numpy-2.5.5-cp313.whl (15 MB)\n"
        "Installing collected packages: numpy, bpy\n"
    )
    _, _, err = made(checkout, "venv")
    assert [line.removeprefix("make: .venv: ").strip() for line in err.splitlines()] == [
        "package 1 of 2: bpy 5.2.3, 402.8 MB", "25 %", "50 %", "75 %", "unpacking 2 packages",
    ]  # fmt: skip


def test_what_such_a_python_left_before_is_repaired(checkout):
    put(checkout, DEBIANS, "python3.13")
    assert subprocess.run([checkout / "path/python3.13", "-m", "venv", checkout / ".venv"], check=False).returncode
    (checkout / ".venv/bin/python").unlink()
    put(checkout, WORKING, "python3.13")
    assert made(checkout, "venv")[0] == 0
    assert (checkout / ".venv/whole").exists()


def test_an_environment_is_made_once_and_brought_up_to_date_without_being_made_again(checkout):
    put(checkout, WORKING, "python3.13")
    assert made(checkout, "venv")[0] == 0
    assert made(checkout, "venv")[0] == 0
    log = (checkout / "log").read_text().splitlines()
    assert log[0] == "venv"
    assert [line.split()[:3] for line in log[1:]] == [["-m", "pip", "install"]]
    assert {"--require-hashes", "requirements/base.lock"} < set(log[1].split())
    time.sleep(0.02)
    (checkout / "requirements/base.lock").touch()
    assert made(checkout, "venv")[0] == 0
    assert [line.split()[0] for line in (checkout / "log").read_text().splitlines()] == ["venv", "-m", "-m"]


@pytest.mark.parametrize("ended_by", ["a failure", "a kill"])
def test_what_was_made_half_is_made_anew(checkout, ended_by):
    put(checkout, WORKING, "python3.13")
    if ended_by == "a failure":
        status, _, err = made(checkout, "venv", BROKEN="yes")
        assert status != 0
        assert "the packages of .venv could not be installed, for the reason above" in err
    else:
        process = make(checkout, "venv", SLOW="30")
        while not (checkout / ".venv/half").exists():
            assert process.poll() is None
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate(timeout=60)
    assert (checkout / ".venv/half").exists()
    assert made(checkout, "venv")[0] == 0
    assert (checkout / "log").read_text().splitlines()[:2] == ["venv", "venv"]
    assert (checkout / ".venv/whole").exists()
    assert not (checkout / ".venv/half").exists()
    assert "Nothing to be done" in made(checkout, "venv")[1]


@pytest.mark.parametrize("variable", ["HOME", "XDG_CACHE_HOME", "PIP_CACHE_DIR"])
def test_a_home_that_cannot_be_written_to_makes_pip_go_without_a_cache(checkout, variable):
    put(checkout, WORKING, "python3.13")
    assert made(checkout, "venv", **{variable: "/proc/none"})[0] == 0
    assert "--no-cache-dir" in (checkout / "log").read_text()


def test_another_python_than_is_needed_is_one_line(checkout):
    for python in ("/nowhere/python", shutil.which("false")):
        status, _, err = made(checkout, "venv", f"PYTHON={python}")
        assert status != 0
        assert f"{python} is no Python 3.13" in err.splitlines()[0]
        assert not (checkout / ".venv").exists()
