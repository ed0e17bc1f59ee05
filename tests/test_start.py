# SPDX-License-Identifier: GPL-3.0-or-later
"""What a start does not load: modules that most uses do without. What images are given: memory that is there."""

import subprocess
import sys
from importlib.util import find_spec

import pytest
from worlds import GENERATE, ROOT, write_world

OTHERS = (  # other sources than a PLY and a path, other places than a folder
    "bpy", "tarfile", "urllib.request", "noisy_world.rooms", "noisy_world.scenes.gltf",
    "noisy_world.trajectories.handheld", "noisy_world.sources.lit_scene",
    "noisy_world.sources.blender_process", "noisy_world.dataset.address_run",
)  # fmt: skip
FILES = ("cv2", "yaml", "OpenEXR", "importlib.metadata", "noisy_world.layouts",
         "noisy_world.layouts.stored_recording", "noisy_world.scenes.ply", "noisy_world.preset.keys",
         "noisy_world.dataset", "noisy_world.sources", "noisy_world.perturbations.shipped.fog")  # fmt: skip

PERTURBED = """
import platform
import numpy as np
from noisy_world.perturb import apply
image = np.full((480, 640, 3), 99, np.uint8)
for _ in range(3):
    apply(image, "glass_blur", 3)
if platform.libc_ver()[0] == "glibc":  # whose freed memory is kept: no page of it is asked for again
    from resource import RUSAGE_SELF, getrusage
    before = getrusage(RUSAGE_SELF).ru_minflt
    apply(image, "glass_blur", 3)
    pages = getrusage(RUSAGE_SELF).ru_minflt - before
    assert pages < 300, f"{pages} new pages for an image of {image.nbytes // 4096}"
"""


def python_without(modules, code):
    """Run code in a process in which to import one of the modules is an error."""
    assert [name for name in modules if name.startswith("noisy_world") and not find_spec(name)] == []
    refusing = f"import sys\nsys.path[:0] = [{str(ROOT / 'addon')!r}]\nsys.modules.update(dict.fromkeys({modules!r}))\n"
    done = subprocess.run([sys.executable, "-c", refusing + code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_library_of_perturbations_loads_no_files_and_no_sources():
    python_without([*OTHERS, *FILES], "import noisy_world.perturb")
    python_without([*OTHERS, "yaml", "OpenEXR", "noisy_world.dataset", "noisy_world.sources"], PERTURBED)


def test_a_run_loads_the_sources_that_it_has(tmp_path):
    pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")
    size, render = (16, 12), {"engine": "embree", "samples": 1, "backend": "reference"}
    preset = write_world(tmp_path / "world", frames=1, size=size, render=render, settings=[{"name": "clean"}])
    words = [str(GENERATE), str(preset), "--out", str(tmp_path / "out")]
    python_without(OTHERS, f"import runpy\nsys.argv = {words!r}\nrunpy.run_path(sys.argv[0], run_name='__main__')")
