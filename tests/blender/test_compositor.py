# SPDX-License-Identifier: GPL-3.0-or-later
"""Chains of groups: the same pixels from arrays, an Image and a render; on any frame, in any process."""

import subprocess
import sys

import bpy
import cv2
import numpy as np
import OpenEXR
import pytest
from dataclasses import replace
from group_tools import IDENTIFIERS, by_nodes, digests, keep_written, many_by_nodes, picture, step_of
from shown import evaluate_scene, image_of
from worlds import ROOT

import srgb
from noisy_world.nodes.chain_scene import hide_chain, make_chain, show_chain
from noisy_world.nodes.compositor import Compositor
from noisy_world.nodes.datablocks import read_rows
from noisy_world.images.pixels import rgb_bytes
from noisy_world.core.errors import StorageError
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.execution import perturb_rgb
from noisy_world.perturbations.kinds import ColourPerturbation, FrameContext
from noisy_world.core.schema import ConfigPath
from noisy_world.perturbations import registry

NAMES = [item.name for item in registry().values() if isinstance(item, ColourPerturbation) and item.nodes]
MIXED = [
    {"gaussian_noise": {"severity": 3, "mode": "dynamic"}},
    {"fog": {"severity": 5, "mode": "dynamic"}},
    {"motion_blur": {"levels": [0, 1, 5], "mode": "dynamic"}},
    {"contrast": {"severity": 1}},
]


def depth_for(image):
    return np.repeat(np.linspace(0, 6, image.shape[0], dtype=np.float32)[:, None], image.shape[1], axis=1)


def steps_of(items):
    return parse_steps(items, ConfigPath("test"), registry())


def scene_of(size):
    scene = bpy.data.scenes.new("Artist")
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.compositor_precision = "FULL"
    scene.render.compositor_device = "CPU"
    return scene


@pytest.fixture
def empty():
    """A file that holds nothing, not even the groups that other tests keep."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


def test_a_keyed_chain_shows_what_the_generator_writes(tmp_path):
    rgb = picture(60, 100)
    steps = steps_of(MIXED)
    with Compositor((100, 60), {"x": steps}, 100) as compositor:
        written = [compositor.evaluate(rgb, {"x": (k, IDENTIFIERS)})[0]["x"] for k in range(8)]
    scene = scene_of((100, 60))
    chain = make_chain("mixed", steps, range(8), IDENTIFIERS)
    show_chain(scene, chain, image=image_of(rgb), encoded=True)
    differ = set()
    for k in (5, 0, 7, 3):
        scene.frame_set(k)
        shown = evaluate_scene(scene, tmp_path)
        assert np.array_equal(shown, rgb if written[k] is None else written[k])
        differ.add(shown.tobytes())
    assert len(differ) == 4


def test_a_render_and_its_image_are_perturbed_alike(tmp_path):
    scene = scene_of((48, 32))
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.world = bpy.data.worlds.new("World")
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (0.2, 0.5, 0.05, 1)
    steps = steps_of([{"gaussian_noise": {"severity": 2}}, {"brightness": {"severity": 3}}])
    scene.frame_set(0)
    chain = make_chain("two", steps, range(1), IDENTIFIERS)
    show_chain(scene, chain)
    behind_render = evaluate_scene(scene, tmp_path)
    show_chain(scene, chain, image=image_of(np.full((32, 48, 3), (0.2, 0.5, 0.05), np.float32)))
    before_image = evaluate_scene(scene, tmp_path)
    assert np.array_equal(behind_render, before_image)
    # Light in, light out: the same as encoded colour perturbed and decoded (IEC 61966-2-1).
    rgb = np.broadcast_to(srgb.encoded([0.2, 0.5, 0.05]).astype(np.float32), (32, 48, 3))
    with Compositor((48, 32), {"x": steps}, 48) as compositor:
        made = compositor.evaluate(rgb, {"x": (0, IDENTIFIERS)})[0]["x"]
    assert np.abs(srgb.linear(made) - behind_render).max() < 1e-4
    assert behind_render.std() > 0.05


def test_hiding_gives_back_what_was_there(empty):
    scene = scene_of((8, 8))
    own = bpy.data.node_groups.new("Own", "CompositorNodeTree")
    scene.compositing_node_group = own
    before = {tree.name for tree in bpy.data.node_groups}
    show_chain(scene, make_chain("one", steps_of(MIXED), range(3), IDENTIFIERS))
    show_chain(scene, make_chain("other", steps_of(MIXED[:1]), range(3), IDENTIFIERS))
    hide_chain(scene)
    hide_chain(scene)
    assert scene.compositing_node_group == own
    assert {tree.name for tree in bpy.data.node_groups} == before
    assert len(bpy.data.actions) == 0


def test_the_user_s_own_frame_changes_nothing():
    rgb = picture(24, 32)
    wanted = by_nodes("gaussian_noise", rgb, [3], severity=3)[0]
    bpy.context.scene.frame_set(17)
    assert np.array_equal(by_nodes("gaussian_noise", rgb, [3], severity=3)[0], wanted)
    assert bpy.context.scene.frame_current == 17


def test_the_user_s_scenes_are_left_as_they_are(empty):
    scene = bpy.context.scene
    scene.view_settings.view_transform = "AgX"
    scene.render.dither_intensity = 1.0
    scene.render.filepath = "//mine"

    def state():
        kept = {}
        for name, owner in (("render", scene.render), ("view", scene.view_settings), ("scene", scene)):
            for item in owner.bl_rna.properties:
                if item.type in ("BOOLEAN", "INT", "FLOAT", "STRING", "ENUM") and not getattr(item, "is_array", False):
                    kept[name, item.identifier] = getattr(owner, item.identifier)
        return kept

    before, active = state(), bpy.context.window.scene.name
    with Compositor((24, 16), {"x": [step_of("brightness", severity=2)]}, 24) as compositor:
        assert compositor.evaluate(picture(16, 24), {"x": (0, IDENTIFIERS)})[0]["x"] is not None
    assert state() == before
    assert bpy.context.window.scene.name == active
    assert [item.name for item in bpy.data.scenes] == [scene.name]
    assert len(bpy.data.node_groups) == 0
    assert {item.name for item in bpy.data.images} <= {"Render Result"}


def test_a_frame_is_its_seed_s_and_its_number_s_alone():
    """What was drawn before does not matter; another seed does, and whether the pattern is redrawn, drifts or stays."""
    rgb = picture(36, 64)
    depth_m = depth_for(rgb)
    chains = {(name, ""): [step_of(name, severity=3)] for name in NAMES}
    chains |= {(name, kind): [step_of(name, severity=3, temporal=kind)] for name in NAMES for kind in temporals(name)}
    keep_written(chains)
    with Compositor((64, 36), chains, 64) as compositor:
        alone, other, first, last = (
            compositor.evaluate(rgb, dict.fromkeys(chains, (index, (seed, "room", "setting"))), depth_m)[0]
            for index, seed in ((3, 7), (3, 8), (0, 7), (3, 7))
        )
    for (name, kind), (step,) in chains.items():
        what = name, kind
        assert np.array_equal(last[what], alone[what]), what
        assert np.array_equal(last[what], other[what]) == (not temporals(name)), what
        assert np.array_equal(first[what], last[what]) == (step.temporal == "fixed" or not temporals(name)), what


def temporals(name):
    item = registry()[name]
    return () if item.is_repeatable(item.at_severity(3)) else item.temporals


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (9, 2), (33, 17)])
def test_small_and_odd_frames(shape):
    chains = {name: [step_of(name, severity=5)] for name in NAMES}
    images = picture(*shape), np.zeros((*shape, 3), np.float32), np.ones((*shape, 3), np.float32)
    for made in many_by_nodes(chains, images, depth_m=depth_for(images[0])):
        for name, image in made.items():
            assert image.shape == (*shape, 3), name
            assert np.isfinite(image).all(), name
            assert image.min() >= 0, name
            assert image.max() <= 1, name


def test_what_is_evaluated_is_what_the_groups_are(tmp_path):
    """The generator evaluates the groups written out into one another; a person's Blender, as they are."""
    rgb = picture(40, 64)
    scene = scene_of((64, 40))
    chains = {name: [step_of(name, severity=4)] for name in ("fog", "glass_blur", "pixelate", "shot_noise")}
    (made,) = many_by_nodes(chains, [rgb])
    scene.frame_set(0)
    for name, steps in chains.items():
        show_chain(scene, make_chain("one", steps, range(1), IDENTIFIERS), image=image_of(rgb), encoded=True)
        assert np.array_equal(evaluate_scene(scene, tmp_path), made[name]), name


def test_bytes_are_the_nearest_to_the_values():
    """Ties go to the even byte, as IEEE 754 rounds: the values here are half way between two bytes, or near it."""
    halves = (np.arange(255, dtype=np.float32) + np.float32(0.5)) / np.float32(255)
    rows = [np.nextafter(halves, np.float32(0)), halves, np.nextafter(halves, np.float32(1)), 1 - halves]
    rgb = np.stack([np.stack(rows), np.stack(rows[::-1]), np.stack(rows) ** 2], axis=-1)
    steps = steps_of([{"contrast": {"factor": 1.0}}])
    with Compositor((255, 4), {"x": steps}, 255) as compositor:
        values = compositor.evaluate(rgb, {"x": (0, IDENTIFIERS)})[0]["x"]
        made = compositor.perturb(rgb, {"x": (0, IDENTIFIERS)})["x"][0]
    assert np.array_equal(made, np.rint(values * np.float32(255)))
    assert np.array_equal(made, rgb_bytes(values))
    assert (np.mod(values * np.float32(255), 1) == 0.5).sum() > 100


def test_a_scratch_file_that_is_cut_short_is_named(tmp_path):
    path = tmp_path / "frame.exr"
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    channels = {"a.V": values, "b.V": values + 100}
    with OpenEXR.File({"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(path))
    assert np.array_equal(read_rows(path, (4, 3), 2), np.stack([values, values + 100], axis=1))
    whole = path.read_bytes()
    for count in (len(whole) - 1, len(whole) - 40, 20, 0):
        path.write_bytes(whole[:count])
        with pytest.raises(StorageError, match="cut short"):
            read_rows(path, (4, 3), 2)


def test_all_settings_in_one_call_are_those_alone():
    rgb = picture(40, 64)
    chains = {f"{name} {severity}": [step_of(name, severity=severity)] for name in NAMES for severity in (1, 5)}
    frames = {name: (2, (7, "room", name)) for name in chains}
    assert len(chains) > 32  # more than go into one call
    with Compositor((64, 40), chains, 64) as compositor:
        together, notes = compositor.evaluate(rgb, frames, depth_for(rgb))
    assert set(together) == set(notes) == set(chains)
    for name in list(chains)[::7]:
        with Compositor((64, 40), {name: chains[name]}, 64) as compositor:
            alone = compositor.evaluate(rgb, {name: frames[name]}, depth_for(rgb))[0][name]
        assert np.array_equal(alone, together[name])


def test_severity_zero_is_nothing_and_costs_nothing():
    rgb = rgb_bytes(picture(16, 24))
    with Compositor((24, 16), {"x": steps_of([{"fog": {"severity": 0}}])}, 24) as compositor:
        made, notes = compositor.perturb(rgb, {"x": (0, IDENTIFIERS)})["x"]
    assert made is None
    assert notes[0]["severity"] == 0
    # Nor is it seen in the chains that are written into one file with it.
    chains = {"x": steps_of([{"fog": {"severity": 0}}]), "y": steps_of([{"contrast": {"factor": 1.0}}])}
    with Compositor((24, 16), chains, 24) as compositor:
        made = compositor.perturb(rgb, dict.fromkeys(chains, (0, IDENTIFIERS)))
    assert made["x"][0] is None
    assert np.array_equal(made["y"][0], rgb)
    # Beside a step that does something it passes the frame bit for bit.
    with Compositor((24, 16), {"x": steps_of([{"fog": {"severity": 0}}, {"contrast": {"factor": 1.0}}])}, 24) as both:
        made, _ = both.perturb(rgb, {"x": (0, IDENTIFIERS)})["x"]
    assert np.array_equal(made, rgb)


def test_what_several_settings_do_alike_is_done_once():
    """Blur draws nothing, so a severity that is drawn for a frame is that of another setting; noise has its stream."""
    rgb = rgb_bytes(picture(16, 24))
    chains = {f"{name} {k}": [step_of(name, severity=3)] for name in ("gaussian_blur", "gaussian_noise") for k in "ab"}
    chains["drawn"] = steps_of([{"gaussian_blur": {"levels": [1, 3], "mode": "dynamic"}}])
    chains |= {f"stream {k}": [replace(step_of("gaussian_noise", severity=3), stream="one")] for k in "ab"}
    with Compositor((24, 16), chains, 24) as compositor:
        for index in range(6):
            made = compositor.perturb(rgb, {name: (index, (7, "room", name)) for name in chains})
            images = {name: image for name, (image, _) in made.items()}
            assert images["gaussian_blur a"] is images["gaussian_blur b"]
            drawn = made["drawn"][1][0]["severity"]
            assert np.array_equal(images["drawn"], images["gaussian_blur a"]) == (drawn == 3)
            assert not np.array_equal(images["gaussian_noise a"], images["gaussian_noise b"])
            assert images["stream a"] is images["stream b"]
            assert not np.array_equal(images["stream a"], images["gaussian_noise a"])


def test_chains_of_one_stream_may_show_a_frame_at_different_times():
    """Their random images come from one node, so they take turns."""
    rgb = rgb_bytes(picture(16, 24))
    step = replace(step_of("gaussian_noise", severity=3), stream="one")
    frames = {name: (index, (7, "room", name)) for name, index in (("a", 4), ("b", 9), ("c", 4))}
    with Compositor((24, 16), {name: [step] for name in frames}, 24) as compositor:
        together = compositor.perturb(rgb, frames)
    assert together["a"][0] is together["c"][0]
    for name in ("a", "b"):
        with Compositor((24, 16), {name: [step]}, 24) as compositor:
            assert np.array_equal(compositor.perturb(rgb, {name: frames[name]})[name][0], together[name][0])
    assert not np.array_equal(together["a"][0], together["b"][0])


def test_two_processes_make_the_same_bytes():
    code = (
        "import sys\nsys.path[:0] = sys.argv[1:3]\nfrom group_tools import digests\nprint('@', *digests(sys.argv[3:]))"
    )
    command = [sys.executable, "-c", code, str(ROOT / "addon"), str(ROOT / "tests/support"), *NAMES]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    (found,) = (line.split()[1:] for line in result.stdout.splitlines() if line.startswith("@"))
    assert dict(zip(NAMES, found, strict=True)) == dict(zip(NAMES, digests(NAMES), strict=True))


def test_a_share_of_the_effect_is_the_references_and_the_chains_that_people_see(tmp_path):
    """Mix and mask, keyed over the frames: nodes on arrays, the reference, and a chain after an image agree."""
    rgb = picture(60, 100)
    cv2.imwrite(str(tmp_path / "mask.png"), np.linspace(0, 255, 100).astype(np.uint8)[None].repeat(60, 0))
    (tmp_path / "each").mkdir()
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"each/{number}.png"), np.full((4, 6), 90 * number, np.uint8))
    mask, each = str(tmp_path / "mask.png"), str(tmp_path / "each")
    steps = steps_of(
        [{"contrast": {"severity": 5, "mix": [1, 0.25], "mask": mask}}, {"brightness": {"severity": 4, "mix": 0.5}}]
    )
    tinted = {"bloom": {"severity": 5, "colour": [1, 0.5, 0.0], "mask": mask}}
    chains = {"x": steps, "y": steps_of([{"contrast": {"severity": 5, "mask": each}}]), "z": steps_of([MIXED[3]])}
    chains["tinted"] = steps_of([tinted])
    with Compositor((100, 60), chains, 100) as compositor:
        found = [compositor.evaluate(rgb, dict.fromkeys(chains, (k, IDENTIFIERS)))[0] for k in range(3)]
    for name, own in chains.items():
        for k in range(3):
            wanted, _ = perturb_rgb(own, rgb, FrameContext(k, IDENTIFIERS))
            assert np.abs(rgb_bytes(found[k][name]).astype(int) - wanted).max() <= 1, (name, k)
    assert not np.array_equal(found[0]["y"], found[1]["y"])
    assert np.array_equal(found[1]["x"], found[2]["x"])
    scene = scene_of((100, 60))
    show_chain(scene, make_chain("shared", steps, range(3), IDENTIFIERS), image=image_of(rgb), encoded=True)
    for k in (0, 1):
        scene.frame_set(k)
        assert np.abs(evaluate_scene(scene, tmp_path) - found[k]["x"]).max() < 1e-4
    chain = make_chain(
        "shared", steps_of([{"contrast": {"severity": 5}}, {"brightness": {"severity": 4}}]), [0], IDENTIFIERS
    )
    assert [chain.nodes[name].inputs["Mix"].default_value for name in ("Contrast", "Brightness")] == [1, 1]
    assert not chain.nodes["Contrast"].inputs["Mask"].is_linked
