# SPDX-License-Identifier: GPL-3.0-or-later
"""Nothing but what stands on Blender needs it to be imported, and older Pythons are given what they lack."""

import itertools
import subprocess
import sys
from pathlib import Path, PurePosixPath

import pytest

from noisy_world.core.machine import batched
from noisy_world.dataset.folder_state import _matches

ADDON = Path(__file__).resolve().parents[2] / "addon"
IN_BLENDER = ("nodes", "panel")
IN_BLENDER_BUT = {"render": ("embree", "packets", "ray_session", "source", "triangles")}
EXTRAS = ("bpy", "mathutils", "embreex", "scipy", "gtsam", "pandas", "ray", "fsspec", "rerun", "mujoco")


def importable(parts):
    """Whether a module, by the parts of its name after noisy_world's, is imported where there is no Blender."""
    if parts[-1] == "__main__" or "programs" in parts or parts[0] in IN_BLENDER:
        return False
    return len(parts) == 1 or parts[1] in IN_BLENDER_BUT.get(parts[0], (parts[1],))


def test_every_module_but_those_of_blender_is_imported_without_it():
    package = ADDON / "noisy_world"
    found = [path.relative_to(package).with_suffix("").parts for path in package.rglob("*.py")]
    names = [".".join(["noisy_world", *parts]).removesuffix(".__init__") for parts in found if importable(parts)]
    assert {"noisy_world.perturb", "noisy_world.extend", "noisy_world.cli.command", "noisy_world.render.source"} <= {
        *names
    }
    code = f"""
import sys
sys.path.insert(0, {str(ADDON)!r})
sys.modules.update(dict.fromkeys({EXTRAS!r}))
for name in {names!r}:
    __import__(name)
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr


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
