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
    [MODULES, ["noisy_world.pipeline.run"], ["noisy_world", "noisy_world.recipes.opening"], COMMAND],
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
        "addon/noisy_world/core/scenes/mesh.py": "import bpy\n",
        "addon/noisy_world/core/scenes/ply.py": "from ...blender import scene\n",
        "addon/noisy_world/core/datasets/images.py": "import cv2\n",
        "addon/noisy_world/core/scenes/selfcheck.py": "from ...rooms import build_room\n",
        "addon/noisy_world/rooms/shell.py": "from ..core.trajectories.handheld import handheld_path\n",
        "addon/noisy_world/rooms/light.py": "from ..sources import find_scenes\n",
        "addon/noisy_world/blender/camera.py": "from ..pipeline.run import Run\n",
        "addon/noisy_world/pipeline/run.py": "from ..blender.session import Session\n",
        "addon/noisy_world/pipeline/colour.py": "from ..sources.mesh import MeshSource\n",
        "addon/noisy_world/pipeline/frame_writer.py": "from ..cli.entry import Entry\n",
        "addon/noisy_world/sources/mesh.py": "from ..blender.session import Session\n",
        "addon/noisy_world/sources/recording.py": "from ..pipeline.run import Run\n",
        "addon/noisy_world/sources/rendering.py": "from ..rays.session import RaySession\n",
        "addon/noisy_world/rays/session.py": "from ..blender.session import Session\n",
        "addon/noisy_world/rays/colours.py": "import bpy\n",
        "addon/noisy_world/rays/embree.py": "import embreex\n",
        "addon/noisy_world/core/planning/plan.py": "from ...sources import find_scenes\n",
        "addon/noisy_world/perturbations/fog.py": "from ..cli.entry import Entry\n",
        "addon/noisy_world/ui/runs.py": "from ..cli import generate\n",
        "addon/noisy_world/ui/tracking.py": "from ..evaluation.metrics import score\n",
        "addon/noisy_world/storage/packing.py": "from ..pipeline.run import Run\n",
        "addon/noisy_world/storage/address.py": "import fsspec\n",
        "addon/noisy_world/cli/missing.py": "import bpy\n",
        "addon/noisy_world/cli/running.py": "from ..ui import runs\n",
        "addon/noisy_world/recipes/opened.py": "from ..cli.entry import Entry\n",
        "addon/noisy_world/recipes/recipe.py": "import cv2\n",
    }
    for name, line in breaches.items():
        path = tmp_path / name
        path.write_text(path.read_text() + "\n" + line)
    ruff = str(Path(sys.executable).parent / "ruff")
    command = [ruff, "check", "--select", "TID251,TID253", "--output-format", "concise", str(tmp_path)]
    found = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    for name in breaches:
        assert name in found.replace(str(tmp_path), ""), f"a breach in {name} went unseen:\n{found}"
