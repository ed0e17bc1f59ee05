# SPDX-License-Identifier: GPL-3.0-or-later
"""The pictures in the image editor: the generator's bytes, following the sliders without rendering again."""

import time

import bpy
import cv2
import numpy as np
import pytest
from refusals import refused
from preview_tools import IDENTIFIERS, SIZE, add, cycles_scene, pixels, steps_of
from worlds import generate, path_poses, write_world

from noisy_world.nodes.chain_scene import shown_chain
from noisy_world.nodes.compositor import Compositor
from noisy_world.render.own_stills import render_stills
from noisy_world.nodes.datablocks import fcurves_of
from noisy_world.core.errors import NoisyWorldError
from noisy_world.images.pixels import rgb_bytes
from noisy_world.perturbations.execution import perturb_depth, perturb_rgb
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.dataset.completion import colour_depth
from noisy_world.panel import beginning, frame_preview, operators, presets, preview, loading


pytestmark = pytest.mark.usefixtures("registered")


@pytest.fixture
def renders(monkeypatch):
    """The frames that were rendered, one after another."""
    made = []

    def render(scene, frames, **how):
        made.extend(frames)
        return render_stills(scene, frames, **how)

    monkeypatch.setattr(frame_preview, "render_stills", render)
    return made


def clean_rgb(scene, frame):
    return rgb_bytes(render_stills(scene, [frame])[0].rgb)


@pytest.mark.parametrize("backend", ["compositor", "reference"])
def test_colour_is_shown_as_the_generator_writes_it(room, backend):
    add(room, "fog", severity=2.0)
    add(room, "gaussian_noise", severity=3.0, mode="dynamic")
    room.noisy_world.render.backend = backend
    room.frame_set(4)
    picture, about = frame_preview.draw_colour(room)
    rendered = render_stills(room, [4])[0].rgb
    clean = rgb_bytes(rendered)
    steps = steps_of({"fog": {"severity": 2}}, {"gaussian_noise": {"severity": 3, "mode": "dynamic"}})
    if backend == "reference":
        expected, _ = perturb_rgb(steps, rendered, FrameContext(4, IDENTIFIERS))
    else:
        with Compositor(SIZE, {"x": steps}, SIZE[0]) as compositor:
            expected, _ = compositor.perturb(rendered, {"x": (4, IDENTIFIERS)})["x"]
    assert np.array_equal(picture, expected)
    assert not np.array_equal(picture, clean)
    assert about == "Frame 4: fog, gaussian_noise"
    room.noisy_world.preview_split = 0.5
    picture, _ = frame_preview.draw_colour(room)
    assert np.array_equal(picture[:, : SIZE[0] // 2], clean[:, : SIZE[0] // 2])
    assert np.array_equal(picture[:, SIZE[0] // 2 :], expected[:, SIZE[0] // 2 :])


def test_a_picture_that_is_white_says_which_step_made_it_so(room):
    room.noisy_world.render.backend = "reference"
    for name in ("frost", "snow"):
        add(room, name, severity=5.0)
    room.frame_set(0)
    picture, about = frame_preview.draw_colour(room)
    white = (picture == 255).all(axis=2).mean()
    assert white > 0.4
    assert about.startswith(f"Frame 0: {white:.0%} of a frame's pixels are white")
    assert "snow makes most" in about


def test_grey_is_shown_as_it_is_written(room):
    room.noisy_world.output.colour = "grey"
    room.frame_set(2)
    picture, _ = frame_preview.draw_colour(room)
    weighted = 255 * np.clip(render_stills(room, [2])[0].rgb, 0, 1).astype(float) @ [0.299, 0.587, 0.114]
    assert np.abs(picture - weighted[..., None]).max() <= 0.5 + 1e-3
    add(room, "fog", severity=2.0)
    fogged, _ = frame_preview.draw_colour(room)
    assert (fogged == fogged[..., :1]).all()
    assert not np.array_equal(fogged, picture)


def test_depth_takes_part_in_colour_where_it_is_asked_for(room):
    add(room, "fog_depth", severity=3.0)
    fogged, _ = frame_preview.draw_colour(room)
    assert np.abs(fogged.astype(int) - clean_rgb(room, room.frame_current)).mean() > 10


def test_without_perturbations_it_is_the_render(room):
    room.frame_set(2)
    picture, about = frame_preview.draw_colour(room)
    assert np.array_equal(picture, clean_rgb(room, 2))
    assert about == "Frame 2: clean"


def move_camera(scene):
    scene.camera.location.x += 1
    bpy.context.view_layer.update()


def widen(scene):
    scene.noisy_world.camera.fx += 1


def deviate(scene):
    scene.noisy_world.deviation_translation_m = 0.1


def test_the_picture_follows_the_sliders_without_rendering_again(editor, scene, renders):
    cycles_scene((0.1, 0.2, 0.05))
    settings = scene.noisy_world
    noise = add(scene, "gaussian_noise", severity=1.0)
    settings.preview = True
    preview.flush()
    scene.frame_set(3)
    bpy.context.view_layer.update()
    assert bpy.ops.noisy_world.preview_frame() == {"FINISHED"}
    image = editor.spaces.active.image
    assert image.name == frame_preview.PICTURES["COLOUR"]
    weak = pixels(image)
    noise.severity = 5.0
    preview.flush()
    strong = pixels(image)
    assert strong.std() > 2 * weak.std()
    scene.frame_set(7)  # it stays with the frame that was asked for
    noise.severity = 1.0
    preview.flush()
    assert np.array_equal(pixels(image), weak)
    assert renders == [3]
    for change in (move_camera, widen, deviate):  # which make the picture one of before: no slider renders
        change(scene)
        noise.severity = 2.0
        preview.flush()
        assert np.array_equal(pixels(image), weak)
        assert frame_preview._outdated[scene.session_uid] == {"COLOUR"}
        scene.frame_set(3)
        noise.severity = 1.0
        assert bpy.ops.noisy_world.preview_frame() == {"FINISHED"}
        assert not frame_preview._outdated[scene.session_uid]
        weak = pixels(image)
    assert renders == [3, 3, 3, 3]
    settings.preview = False
    preview.flush()
    before = pixels(image)
    noise.severity = 4.0
    preview.flush()
    assert np.array_equal(pixels(image), before)


def test_pictures_that_take_long_are_coarse_until_a_pause(editor, scene, monkeypatch):
    cycles_scene((0.1, 0.2, 0.05))
    noise = add(scene, "gaussian_noise", severity=1.0)
    add(scene, "defocus_blur", severity=1.0)
    scene.noisy_world.preview = True
    preview.flush()
    assert bpy.ops.noisy_world.preview_frame() == {"FINISHED"}
    before = pixels(editor.spaces.active.image)
    monkeypatch.setattr(frame_preview, "seconds_taken", lambda _: 2.0)
    noise.severity = 2.0
    assert preview._follow() == preview.POLL_S
    coarse = pixels(editor.spaces.active.image)
    assert not np.array_equal(coarse, before)
    assert coarse.shape == before.shape
    assert np.array_equal(coarse[0::2, :-1:2], coarse[1::2, 1::2])  # each pixel of a half is four of the picture
    # A coarse picture that takes long itself waits.
    monkeypatch.setitem(frame_preview._half_took_s, scene.session_uid, 1.0)
    noise.severity = 5.0
    assert np.array_equal(pixels(editor.spaces.active.image), coarse)
    now_s = time.perf_counter()
    monkeypatch.setattr(preview.time, "perf_counter", lambda: now_s + preview.PAUSE_S)
    assert preview._follow() is None
    after = pixels(editor.spaces.active.image)
    assert not np.array_equal(after[0::2, :-1:2], after[1::2, 1::2])


def test_a_frame_that_a_shorter_path_does_not_have_is_refused(scene):
    cycles_scene((0.1, 0.2, 0.05))
    refused(frame_preview.draw_colour, scene, 10**6, names="frame 1000000 is not there any more", error=NoisyWorldError)


def test_a_mistake_is_told_and_the_picture_stays(editor, scene):
    cycles_scene((0.1, 0.2, 0.05))
    add(scene, "gaussian_noise", severity=1.0)
    scene.noisy_world.preview = True
    preview.flush()
    assert bpy.ops.noisy_world.preview_frame() == {"FINISHED"}
    before = pixels(editor.spaces.active.image)
    for _ in range(2):
        add(scene, "desync")
    assert "twice" in preview._errors[scene.session_uid]
    assert np.array_equal(pixels(editor.spaces.active.image), before)


def test_what_no_editor_shows_is_not_drawn(editor, scene):
    cycles_scene((0.1, 0.2, 0.05))
    noise = add(scene, "gaussian_noise", severity=1.0)
    scene.noisy_world.preview = True
    assert bpy.ops.noisy_world.preview_frame() == {"FINISHED"}
    image = editor.spaces.active.image
    editor.type = "VIEW_3D"
    before = pixels(image)
    noise.severity = 5.0
    preview.flush()
    assert np.array_equal(pixels(image), before)


def test_a_frame_that_nothing_follows_costs_no_memory_for_long(room):
    for frame in range(6):
        frame_preview.still_of(room, frame)
    assert list(frame_preview._stills[room.session_uid]) == [2, 3, 4, 5]
    frame_preview.forget(room)
    assert room.session_uid not in frame_preview._stills


def test_depth_is_shown_as_the_generator_perturbs_it(room):
    add(room, "depth_random_missing", severity=3.0)
    room.frame_set(4)
    image, about = frame_preview.draw_depth(room)
    assert bpy.data.scenes[:] == [room]
    (still,) = render_stills(room, [4])
    depth_m, _ = perturb_depth(
        steps_of({"depth_random_missing": {"severity": 3}}), still.depth_m, FrameContext(4, IDENTIFIERS)
    )
    seen_m = depth_m[depth_m > 0]
    assert np.array_equal(image, colour_depth(depth_m, seen_m.min(), seen_m.max()))
    assert about.startswith("Frame 4: depth from")
    assert (room.frame_current, room.render.engine, room.cycles.samples) == (4, "CYCLES", 1)
    assert room.world is not None


@pytest.mark.parametrize(("beyond", "held_m"), [("void", 0.0), ("farthest", 65535 / 24000)])
def test_depth_beyond_the_files_range_is_shown_as_it_is_written_and_told(room, beyond, held_m):
    room.noisy_world.output.depth_scale_per_m = 24000.0  # up to 2.73 m
    room.noisy_world.output.depth_beyond = beyond
    room.frame_set(4)
    image, about = frame_preview.draw_depth(room)
    depth_m = render_stills(room, [4])[0].depth_m
    far = depth_m * 24000.0 > 65535.5
    assert 0.05 < far.mean() < 0.95
    depth_m = np.where(far, np.float32(held_m), np.rint(depth_m * 24000.0).astype(np.float32) / np.float32(24000))
    seen_m = depth_m[depth_m > 0]
    expected = colour_depth(depth_m, float(seen_m.min()), float(seen_m.max()))
    assert np.abs(image.astype(int) - expected).max() <= 1
    assert f"; {100 * far.mean():.3g} % of its pixels lie beyond 2.73 m, as far as " in about
    assert f"and become {'void' if beyond == 'void' else '2.73 m'} (a Depth Scale of " in about


def test_desynchronisation_shows_colour_beside_the_depth_that_goes_with_it(room):
    step = add(room, "desync")
    step.desync.offset = 5
    room.frame_set(2)
    image, about = frame_preview.draw_depth(room)
    assert image.shape == (SIZE[1], 2 * SIZE[0], 3)
    depth_m = render_stills(room, [7])[0].depth_m
    seen_m = depth_m[depth_m > 0]
    assert np.array_equal(image[:, SIZE[0] :], colour_depth(depth_m, seen_m.min(), seen_m.max()))
    assert "Color of frame 2, depth of frame 7" in about
    step.desync.edge = "drop"
    room.frame_set(8)
    refused(frame_preview.draw_depth, room, names="left out", error=NoisyWorldError)


def test_the_operator_makes_the_picture(room):
    add(room, "depth_gaussian_noise")
    assert bpy.ops.noisy_world.preview_depth() == {"FINISHED"}
    assert tuple(bpy.data.images[frame_preview.PICTURES["DEPTH"]].size) == SIZE
    room.noisy_world.steps[0].perturbation = "desync"
    assert bpy.ops.noisy_world.preview_depth() == {"FINISHED"}
    assert tuple(bpy.data.images[frame_preview.PICTURES["DEPTH"]].size) == (2 * SIZE[0], SIZE[1])
    room.camera = None
    assert not bpy.ops.noisy_world.preview_depth.poll()


def is_of(curve, socket):
    return curve.data_path == socket.path_from_id("default_value")


def test_a_preset_run_without_a_window_writes_what_the_picture_shows(scene, tmp_path):
    """From the panel's scene, keyed camera and colours on the one side, from files on the other."""
    clumps = {"visibility_m": 2, "unevenness": 1, "clump_m": 0.5, "falloff_m": 0.4, "temporal": "drift"}
    misty = {"name": "misty", "perturb": [{"fog": {"severity": 2}}, {"fog_depth": clumps}, {"desync": {"offset": 1}}]}
    write_world(tmp_path, settings=[misty], render={"backend": "compositor"})
    bpy.context.view_layer.update()
    for module in (loading, beginning, operators, presets):
        module.register()
    try:
        assert bpy.ops.noisy_world.use_preset(filepath=str(tmp_path / "preset.yaml"), setting="misty") == {"FINISHED"}
        assert bpy.ops.noisy_world.load_scene() == {"FINISHED"}
        assert bpy.ops.noisy_world.load_trajectory() == {"FINISHED"}
        scene.frame_set(2)
        picture, _ = frame_preview.draw_colour(scene)
        pair, _ = frame_preview.draw_depth(scene)
        preview.show(scene)
        chain = shown_chain(scene)
        socket = next(node.inputs["Camera Location"] for node in chain.nodes if "Camera Location" in node.inputs)
        shown_m = [
            [curve.evaluate(frame) for curve in fcurves_of(chain.animation_data) if is_of(curve, socket)]
            for frame in range(6)
        ]
        preview.hide(scene)
    finally:
        for module in (presets, operators, beginning, loading):
            module.unregister()
    away_m = np.linalg.norm(path_poses(6)[:, :3, 3] - path_poses(6)[0, :3, 3], axis=1)
    assert np.abs(np.linalg.norm(shown_m, axis=1) - away_m).max() < 1e-5
    assert away_m[-1] > 0.1
    generate(tmp_path / "preset.yaml", "--out", tmp_path / "out")
    folder = tmp_path / "out" / "misty" / "box" / "results"
    written = cv2.imread(str(folder / "frame000002.png"))[..., ::-1].astype(int)
    apart = np.abs(written - picture)
    assert apart.max() <= 1  # materials decode the colours that the generator renders encoded
    assert (apart > 0).mean() < 1e-3
    written_m = cv2.imread(str(folder / "depth000002.png"), cv2.IMREAD_UNCHANGED) / 6553.5
    seen_m = written_m[written_m > 0]
    expected = colour_depth(written_m.astype(np.float32), seen_m.min(), seen_m.max())
    assert np.abs(pair[:, picture.shape[1] :].astype(int) - expected).mean() < 1.0


def test_the_chains_own_keys_do_not_make_a_frame_stale(editor, scene, renders):
    cycles_scene((0.1, 0.2, 0.05))
    noise = add(scene, "gaussian_noise", severity=1.0, mode="dynamic")
    add(scene, "fog_depth")
    scene.noisy_world.preview = True
    preview.flush()
    bpy.context.view_layer.update()
    assert bpy.ops.noisy_world.preview_frame() == {"FINISHED"}
    for severity in (2.0, 5.0):
        noise.severity = severity
        preview.flush()
        bpy.context.view_layer.update()
    preview.flush()
    assert len(renders) == 1
    assert not frame_preview._outdated[scene.session_uid]
    scene.camera.keyframe_insert("location", frame=0)
    bpy.context.view_layer.update()
    noise.severity = 3.0
    preview.flush()
    assert frame_preview._outdated[scene.session_uid] == {"COLOUR"}
    assert len(renders) == 1


def test_undo_makes_a_frame_stale_where_it_moved_something(editor, scene, renders):
    cycles_scene((0.1, 0.2, 0.05))
    noise = add(scene, "gaussian_noise", severity=1.0)
    scene.noisy_world.preview = True
    preview.flush()
    bpy.ops.ed.undo_push(message="made")
    scene.camera.location.x = 1.0
    bpy.context.view_layer.update()
    bpy.ops.ed.undo_push(message="moved")
    assert bpy.ops.noisy_world.preview_frame() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="shown")
    noise.severity = 2.0
    bpy.ops.ed.undo_push(message="noisier")
    assert len(renders) == 1
    for _ in range(3):
        bpy.ops.ed.undo()
    assert bpy.context.scene.camera.location.x == 0.0
    bpy.context.view_layer.update()
    assert not frame_preview._stills
