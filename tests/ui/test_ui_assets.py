# SPDX-License-Identifier: GPL-3.0-or-later
"""The node groups among Blender's asset libraries: there by a button, gone by a button and with the add-on."""

import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

from noisy_world import panel
from noisy_world.panel import operators


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An add-on whose library lies in a folder of the test's own."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "noisy_world_assets.blend").touch()
    monkeypatch.setattr(operators, "ASSETS", (tmp_path / "assets").resolve())
    panel.register()
    yield tmp_path / "assets"
    panel.unregister()
    bpy.ops.wm.read_factory_settings(use_empty=True)


def libraries():
    return {item.name: item.path for item in bpy.context.preferences.filepaths.asset_libraries}


def test_added_once_and_taken_back(folder):
    before = libraries()
    assert not bpy.ops.noisy_world.remove_asset_library.poll()
    assert bpy.ops.noisy_world.add_asset_library() == {"FINISHED"}
    assert libraries() == before | {"Noisy World": str(folder)}
    assert not bpy.ops.noisy_world.add_asset_library.poll()
    assert bpy.ops.noisy_world.remove_asset_library() == {"FINISHED"}
    assert libraries() == before
    assert bpy.ops.noisy_world.add_asset_library.poll()


def test_it_goes_with_the_add_on_and_no_other_does(folder):
    bpy.context.preferences.filepaths.asset_libraries.new(name="Noisy World", directory=str(folder.parent))
    before = libraries()
    bpy.ops.noisy_world.add_asset_library()
    assert len(libraries()) == len(before) + 1
    panel.unregister()
    assert libraries() == before
    panel.register()
    assert libraries() == before


def test_what_a_user_added_by_hand_stays_and_can_be_removed(folder):
    before = libraries()
    bpy.context.preferences.filepaths.asset_libraries.new(name="My Groups", directory=f"{folder}/")
    assert not bpy.ops.noisy_world.add_asset_library.poll()
    panel.unregister()
    assert set(libraries()) == {*before, "My Groups"}
    panel.register()
    assert bpy.ops.noisy_world.remove_asset_library() == {"FINISHED"}
    assert libraries() == before


def test_it_comes_back_where_the_add_on_keeps_preferences(folder, monkeypatch):
    class Kept:
        returns = False

    monkeypatch.setattr(operators, "_kept", lambda: Kept)
    bpy.ops.noisy_world.add_asset_library()
    there = libraries()
    panel.unregister()
    assert "Noisy World" not in libraries()
    panel.register()
    assert libraries() == there
    bpy.ops.noisy_world.remove_asset_library()
    panel.unregister()
    panel.register()
    assert "Noisy World" not in libraries()


def test_without_a_library_there_is_no_button(folder):
    (folder / "noisy_world_assets.blend").unlink()
    assert not operators.is_built()
    assert not bpy.ops.noisy_world.add_asset_library.poll()


def test_the_package_is_the_add_ons():
    assert operators.PACKAGE == "noisy_world"
    assert operators.NoisyWorldPreferences.bl_idname == "noisy_world"
    assert operators.ASSETS.parent.name == "noisy_world"
