# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands below Blender is tested as it has to work: without Blender."""

import sys
from pathlib import Path

import pytest

pytest.register_assert_rewrite("ply_files")
pytest.register_assert_rewrite("worlds")

WITHOUT_BLENDER = ("core", "perturbations", "pipeline", "rays", "recipes", "sources")

# Files that take longest, of 10 s and more: they begin first, so that no process still has one when the others have
# ended. The first of Blender's build other node groups each, which the rest then read.
FIRST = (
    "ui/window/test_add_on.py",
    "ui/window/test_random_actions.py",
    "executors/test_ray.py",
    "storage/test_killed_runs.py",
    "test_site.py",
    "headless/test_generate.py",
    "blender/test_compositor.py",
    "blender/test_lit_chain.py",
    "blender/test_groups.py",
    "headless/test_assets.py",
    "headless/test_package.py",
    "headless/test_wheel.py",
    "headless/test_real_blender.py",
    "ui/test_ui_shots.py",
    "ui/test_ui_bake_exposure.py",
    "ui/test_ui_artist.py",
    "headless/test_demo.py",
    "headless/test_every_key.py",
    "evaluation/study/test_evaluate_command.py",
    "evaluation/thresholds/test_threshold_command.py",
    "evaluation/study/test_every_setting.py",
    "evaluation/study/test_studies_resumed.py",
    "headless/test_street.py",
    "evaluation/test_installed_evaluation.py",
    "blender/test_nodes_spatter.py",
    "blender/test_nodes_falling.py",
    "evaluation/report/test_report_files.py",
    "simulation/test_simulated_bodies.py",
    "headless/test_noisy_rooms.py",
    "ui/test_ui_this_scene.py",
    "ui/test_ui_generate.py",
    "test_extending.py",
    "measure/test_looking.py",
    "core/trajectories/test_bodies.py",
    "measure/test_twin.py",
    "rays/test_embedded_rooms.py",
    "pipeline/test_shards.py",
    "test_fuzz.py",
    "perturbations/test_installed.py",
)


def pytest_collection_modifyitems(items):
    places = {Path(__file__).parent / name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: places.get(item.path, len(FIRST)))


@pytest.fixture(autouse=True)
def _no_bpy(request, monkeypatch):
    if request.path.relative_to(Path(__file__).parent).parts[0] in WITHOUT_BLENDER:
        monkeypatch.setitem(sys.modules, "bpy", None)  # importing it raises ImportError


@pytest.fixture(scope="session")
def room():
    """The embedded room: one for all."""
    from noisy_world.rooms import kept_room

    return kept_room()


@pytest.fixture(scope="session")
def building(pytestconfig):
    """The lock of the extension's build, which writes the asset library into the package's folder: a function."""
    from locked import locked

    return lambda: locked(pytestconfig.cache.mkdir("noisy_world_build") / "lock")
