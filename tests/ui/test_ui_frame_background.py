# SPDX-License-Identifier: GPL-3.0-or-later
"""A frame that another Blender renders: the same pixels, stopped at once, and the last picture kept."""

import json
from dataclasses import replace

import bpy
import numpy as np
import pytest
from preview_tools import add, cycles_scene, pixels

from noisy_world.render.own_stills import OwnStill
from noisy_world.render.own_stills import StillRequest, read_frames
from noisy_world.core.geometry import Intrinsics
from noisy_world.panel import preview, runs, frame_preview

pytestmark = pytest.mark.usefixtures("registered")


def test_a_frame_rendered_in_the_background_is_the_one_that_is_rendered_here(room):
    """With the preview's chain shown, which the copy of the file holds too."""
    add(room, "fog_depth", severity=5.0)
    room.noisy_world.preview = True
    preview.flush()
    room.frame_set(4)
    run = runs.start_still(room, frame_preview.request_of(room, {4, 7}))
    assert runs.active_still() == run
    assert not bpy.ops.noisy_world.preview_frame.poll()
    run.background.wait()
    assert (run.background.phase, run.background.fraction) == ("finished", 1.0), run.background.error
    found = read_frames(run.folder)
    run.tidy()
    assert sorted(found) == [4, 7]
    for index, frame in found.items():
        here = frame_preview.rendered(room, index)
        assert np.array_equal(frame.rgb, here.rgb)
        assert np.array_equal(frame.depth_m, here.depth_m)


def test_a_frame_of_this_scene_is_asked_for_as_it_is_rendered_here():
    camera = Intrinsics(8, 6, 7.1, 7.3, 3.5, 2.5)
    c2w = np.eye(4)
    c2w[0, 3] = 0.1
    still = OwnStill(2.5, c2w, False, camera, (0.1, 30.0), "eevee", 3, 11, True, 0.4)
    request = StillRequest("Scene", {3: still, 4: replace(still, c2w=None, clip_m=None, engine=None)})
    back = StillRequest.of(json.loads(json.dumps(request.content())))
    assert np.array_equal(back.stills[3].c2w, c2w)
    assert replace(back.stills[3], c2w=None) == replace(still, c2w=None)
    assert back.stills[4] == request.stills[4]
    assert replace(back, stills={}) == replace(request, stills={})


def test_rendering_stops_at_once_and_the_picture_stays(editor, scene):
    cycles_scene((0.1, 0.2, 0.05))
    assert bpy.ops.noisy_world.preview_frame() == {"FINISHED"}
    before = pixels(editor.spaces.active.image)
    run = runs.start_still(scene, frame_preview.request_of(scene, {5}))
    run.background.cancel()
    run.background.wait()
    assert run.background.phase == "stopped"  # a frame that was rendered to its end would be finished
    run.tidy()
    assert not run.folder.exists()
    assert np.array_equal(pixels(editor.spaces.active.image), before)
