# SPDX-License-Identifier: GPL-3.0-or-later
"""Nothing but what stands on Blender needs it to be imported, and older Pythons are given what they lack."""

import itertools
import pkgutil
import subprocess
import sys
from pathlib import Path, PurePosixPath

import pytest

import noisy_world
from noisy_world.core.machine import batched
from noisy_world.dataset.folder_state import _matches

ADDON = Path(__file__).resolve().parents[2] / "addon"
IN_BLENDER = ("noisy_world.nodes", "noisy_world.panel")
EXTRAS = ("bpy", "mathutils", "embreex", "scipy", "gtsam", "pandas", "ray", "fsspec", "rerun", "mujoco")


def test_every_module_but_those_of_blender_is_imported_without_it():
    tops = [item.name for item in pkgutil.iter_modules(noisy_world.__path__, "noisy_world.")]
    assert {"noisy_world.perturb", "noisy_world.extend", "noisy_world.cli", *IN_BLENDER} <= set(tops)
    code = f"""
import pkgutil, sys
sys.path.insert(0, {str(ADDON)!r})
sys.modules.update(dict.fromkeys({EXTRAS!r}))
for top in {[name for name in tops if name not in (*IN_BLENDER, "noisy_world.__main__")]!r}:
    package = __import__(top, fromlist=["__path__"])
    for module in pkgutil.walk_packages(getattr(package, "__path__", ()), top + "."):
        if not module.name.endswith("__main__"):
            __import__(module.name)
print(len([name for name in sys.modules if name.startswith("noisy_world.")]))
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    written = [path for path in (ADDON / "noisy_world").rglob("*.py") if path.parts[-1] != "__main__.py"]
    theirs = [path for path in written if path.relative_to(ADDON / "noisy_world").parts[0] in ("blender", "ui")]
    programs = [path for path in written if "programs" in path.parts]  # other Pythons run these
    assert int(told.stdout) >= len(written) - len(theirs) - len(programs) - 1, "all of them"


def test_values_some_at_a_time():
    assert list(batched("abcdefg", 3)) == [("a", "b", "c"), ("d", "e", "f"), ("g",)]
    assert list(batched(iter(()), 3)) == []
    ahead = itertools.count()
    assert next(batched(ahead, 4)) == (0, 1, 2, 3)
    assert next(ahead) == 4, "no more is taken than is asked for"


PATHS = ("rgb/000001.png", "rgb/1.png", "000001.png", "a/rgb/000001.png", "a/b/c.txt", "a/b/C.txt", "a/.c.txt", "a")
PATTERNS = ("rgb/*.png", "rgb/[0-9]*.png", "**/*.png", "a/**/c.txt", "a/**", "**", "*/*", "a/?c.txt", "a", "*.png/**")


def test_patterns_of_layouts():
    found = {pattern: {path for path in PATHS if matches(path, pattern)} for pattern in PATTERNS}
    assert found["rgb/*.png"] == {"rgb/000001.png", "rgb/1.png"}
    assert found["**/*.png"] == {"rgb/000001.png", "rgb/1.png", "000001.png", "a/rgb/000001.png"}
    assert found["a/**/c.txt"] == {"a/b/c.txt"}
    assert found["a"] == {"a"}


@pytest.mark.skipif(sys.version_info < (3, 13), reason="Path.full_match is Python 3.13's")
def test_patterns_of_layouts_are_those_of_pathlib():
    for path, pattern in itertools.product(PATHS, PATTERNS):
        assert matches(path, pattern) == PurePosixPath(path).full_match(pattern), (path, pattern)


def matches(path, pattern):
    return _matches(PurePosixPath(path).parts, PurePosixPath(pattern).parts)
