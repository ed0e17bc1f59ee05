# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands below rendering is imported without Blender and heavy libraries, and the layers hold in lint."""

import subprocess
import sys
from pathlib import Path

import pytest

ADDON = Path(__file__).resolve().parents[1] / "addon"
LIGHT = ("core", "images", "scenes", "channels", "trajectories", "rooms", "layouts", "preset", "perturbations")


def modules_of(*packages):
    """Return the names of all modules of packages."""
    files = [path for package in packages for path in (ADDON / "noisy_world" / package).rglob("*.py")]
    names = (".".join(path.relative_to(ADDON).with_suffix("").parts) for path in files)
    return sorted(name.removesuffix(".__init__") for name in names)


@pytest.mark.parametrize(
    "modules",
    [modules_of(*LIGHT), modules_of("dataset"), ["noisy_world", "noisy_world.dataset.opening"], modules_of("cli")],
    ids=["below", "dataset", "top", "command"],
)
def test_imports_stay_light(modules):
    code = f"""
import sys
sys.path.insert(0, {str(ADDON)!r})
for module in {modules!r}:
    __import__(module)
print(sorted({{"bpy", "mathutils", "cv2", "OpenEXR", "deflate", "simplejpeg", "yaml", "tqdm"}} & set(sys.modules)))
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_the_lint_rules_would_catch_a_breach(tmp_path):
    # The rules live in files of their own folders: a copy of the tree with one bad import has to fail.
    import shutil

    if shutil.which("ruff", path=str(Path(sys.executable).parent)) is None:
        pytest.skip("ruff is not installed")
    root = ADDON.parent
    shutil.copytree(ADDON, tmp_path / "addon", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(root / "pyproject.toml", tmp_path)
    breaches = {
        "core/streams.py": "import bpy\n",
        "images/pixels.py": "import cv2\n",
        "scenes/ply.py": "from ..render import mesh_session\n",
        "channels/rgb.py": "from ..trajectories import formats\n",
        "trajectories/formats.py": "from ..layouts import layout\n",
        "rooms/living_room.py": "from ..trajectories.handheld import handheld_path\n",
        "rooms/light.py": "from ..sources import find_scenes\n",
        "layouts/tum.py": "from ..preset import keys\n",
        "preset/keys.py": "from ..perturbations import steps\n",
        "perturbations/shipped/fog.py": "from ...cli.entry import Entry\n",
        "nodes/chain.py": "from ..render.engines import Cycles\n",
        "render/mesh_session.py": "from ..dataset.run import Run\n",
        "render/embree.py": "import embreex\n",
        "sources/rendered_mesh.py": "from ..rooms import build_room\n",
        "sources/mesh.py": "from ..render.mesh_session import Session\n",
        "sources/recording.py": "from ..dataset.run import Run\n",
        "dataset/run.py": "import bpy\n",
        "dataset/store.py": "import fsspec\n",
        "dataset/frame.py": "from ..nodes.compositor import Compositor\n",
        "dataset/making.py": "from ..cli.entry import Entry\n",
        "evaluate/report.py": "import pandas\n",
        "executors/jobs.py": "from ..evaluate.study import Study\n",
        "panel/runs.py": "from ..cli import generate\n",
        "panel/generating.py": "from ..evaluate.metrics import score\n",
        "cli/entry.py": "from ..panel import runs\n",
        "cli/command.py": "import bpy\n",
    }
    for name, line in breaches.items():
        path = tmp_path / "addon" / "noisy_world" / name
        path.write_text(path.read_text() + "\n" + line)
    ruff = str(Path(sys.executable).parent / "ruff")
    command = [ruff, "check", "--select", "TID251,TID253", "--output-format", "concise", str(tmp_path)]
    found = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    for name in breaches:
        assert name in found.replace(str(tmp_path), ""), f"a breach in {name} went unseen:\n{found}"
