# SPDX-License-Identifier: GPL-3.0-or-later
"""Importing the core loads neither Blender nor the heavy libraries, and the layers hold where lint cannot see."""

import subprocess
import sys
from pathlib import Path

import pytest

ADDON = Path(__file__).resolve().parents[1] / "addon"
MODULES = sorted(
    ".".join(path.relative_to(ADDON).with_suffix("").parts).removesuffix(".__init__")
    for path in (ADDON / "noisy_world" / "core").rglob("*.py")
)
COMMAND = [
    f"noisy_world.cli.{name}"
    for name in (
        *("command", "generate", "list_command", "export_mesh", "shard_tasks", "study_tasks", "status"),
        *("plan_command", "shard_command", "merge_command"),
        *("recipe_command", "verify_command", "remake", "render_clean", "score_command", "run_odometry"),
    )
]


@pytest.mark.parametrize(
    "modules",
    [MODULES, ["noisy_world.dataset.run"], ["noisy_world", "noisy_world.dataset.opening"], COMMAND],
    ids=["core", "pipeline", "top", "command"],
)
def test_imports_stay_light(modules):
    code = f"""
import sys
sys.path.insert(0, {str(ADDON)!r})
for module in {modules!r}:
    __import__(module)
print(sorted({{"bpy", "mathutils", "cv2", "OpenEXR", "deflate", "yaml", "tqdm"}} & set(sys.modules)))
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
        "addon/noisy_world/scenes/polygon_mesh.py": "import bpy\n",
        "addon/noisy_world/scenes/ply.py": "from ...blender import scene\n",
        "addon/noisy_world/images/pixels.py": "import cv2\n",
        "addon/noisy_world/sources/rendered_mesh.py": "from ...rooms import build_room\n",
        "addon/noisy_world/rooms/living_room.py": "from ..core.trajectories.handheld import handheld_path\n",
        "addon/noisy_world/rooms/light.py": "from ..sources import find_scenes\n",
        "addon/noisy_world/render/mesh_session.py": "from ..pipeline.run import Run\n",
        "addon/noisy_world/dataset/run.py": "from ..blender.session import Session\n",
        "addon/noisy_world/dataset/colour.py": "from ..sources.mesh import MeshSource\n",
        "addon/noisy_world/dataset/making.py": "from ..cli.entry import Entry\n",
        "addon/noisy_world/sources/mesh.py": "from ..blender.session import Session\n",
        "addon/noisy_world/sources/recording.py": "from ..pipeline.run import Run\n",
        "addon/noisy_world/sources/renderers.py": "from ..rays.session import RaySession\n",
        "addon/noisy_world/render/ray_session.py": "from ..blender.session import Session\n",
        "addon/noisy_world/render/triangles.py": "import bpy\n",
        "addon/noisy_world/render/embree.py": "import embreex\n",
        "addon/noisy_world/dataset/plan.py": "from ...sources import find_scenes\n",
        "addon/noisy_world/perturbations/shipped/fog.py": "from ..cli.entry import Entry\n",
        "addon/noisy_world/panel/runs.py": "from ..cli import generate\n",
        "addon/noisy_world/panel/generate.py": "from ..evaluation.metrics import score\n",
        "addon/noisy_world/dataset/packing.py": "from ..pipeline.run import Run\n",
        "addon/noisy_world/dataset/store.py": "import fsspec\n",
        "addon/noisy_world/cli/entry.py": "import bpy\n",
        "addon/noisy_world/cli/entry.py": "from ..ui import runs\n",
        "addon/noisy_world/dataset/loader.py": "from ..cli.entry import Entry\n",
        "addon/noisy_world/dataset/recipe.py": "import cv2\n",
    }
    for name, line in breaches.items():
        path = tmp_path / name
        path.write_text(path.read_text() + "\n" + line)
    ruff = str(Path(sys.executable).parent / "ruff")
    command = [ruff, "check", "--select", "TID251,TID253", "--output-format", "concise", str(tmp_path)]
    found = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    for name in breaches:
        assert name in found.replace(str(tmp_path), ""), f"a breach in {name} went unseen:\n{found}"
