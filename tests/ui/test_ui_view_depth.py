# SPDX-License-Identifier: GPL-3.0-or-later
"""Views whose compositor has no depth: the tab says so, and offers what has one."""

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

from noisy_world.panel import views


def test_a_view_of_an_engine_that_gives_no_depth_is_shown_by_eevee(hall):
    space = next(area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D").spaces.active
    at = SimpleNamespace(scene=hall, space_data=space)
    space.shading.type = "RENDERED"
    assert views.lacks_depth(at)
    bpy.ops.noisy_world.add_step(perturbation="fog")
    assert views.reading_depth(hall) == ()
    bpy.ops.noisy_world.add_step(perturbation="fog_depth")
    assert views.reading_depth(hall) == ("Fog by Depth",)
    views.show_by_eevee(hall, space.shading)
    assert (space.shading.type, space.shading.use_scene_lights, space.shading.use_scene_world) == ("MATERIAL", 1, 1)
    assert hall.render.engine == "CYCLES"
    assert not views.lacks_depth(at)


def test_a_view_of_workbench_offers_no_button_that_cannot_be_pressed(hall, monkeypatch):
    space = next(area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D").spaces.active
    at = SimpleNamespace(scene=hall, space_data=space)
    space.shading.type, said, buttons = "RENDERED", [], []
    bpy.ops.noisy_world.add_step(perturbation="fog_depth")
    monkeypatch.setattr(views, "write", lambda _layout, _context, text, _icon: said.append(text))
    layout = SimpleNamespace(operator=lambda name, **_: buttons.append(name))
    for engine in ("CYCLES", "BLENDER_WORKBENCH"):
        hall.render.engine = engine
        views.draw(layout, at)
    assert [text.rpartition("; ")[2] for text in said] == ["EEVEE's has one", "Preview Frame does"]
    assert buttons == ["noisy_world.show_by_eevee"]
