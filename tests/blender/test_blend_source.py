# SPDX-License-Identifier: GPL-3.0-or-later
"""A .blend in a preset: its files and what of them is hashed, and the same dataset in whatever order it is made."""

import json

import bpy
import numpy as np
import pytest

from own_scenes import new_scene, save
from runs import files_made, planned
from shard_workers import workers_here

from noisy_world.render.engines import RenderFile
from noisy_world.core.errors import InputError


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    """A folder with a .blend that links a library, whose image is a file, and that holds a script."""
    folder = tmp_path_factory.mktemp("hall")
    new_scene()
    image = bpy.data.images.new("paint", 4, 4)
    image.filepath_raw, image.file_format = str(folder / "paint.png"), "PNG"
    image.save()
    material = bpy.data.materials.new("painted")
    texture = material.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    material.node_tree.links.new(texture.outputs[0], material.node_tree.nodes["Principled BSDF"].inputs[0])
    bpy.data.objects["Ball"].data.materials.append(material)
    save(folder, "shelf")
    scene = new_scene()
    bpy.data.objects.remove(bpy.data.objects["Ball"])
    with bpy.data.libraries.load(str(folder / "shelf.blend"), link=True, relative=True) as (_, wanted):
        wanted.objects = ["Ball"]
    scene.collection.objects.link(wanted.objects[0])
    text = bpy.data.texts.new("start.py")
    text.write(f"open({str(folder / 'ran')!r}, 'w')")
    text.use_module = True
    save(folder)
    (folder / "hall.yaml").write_text(
        "scenes: [{name: hall, blend: hall.blend, frames: '1:2'}]\n"
        "settings: [{name: clean}, {name: fog, perturb: [{fog_depth: {severity: 3}}]},\n"
        "  {name: noise, perturb: [{gaussian_noise: {severity: 1}}]}]\n"
        "render: {backend: reference}\noutput: {image: png}\n"
    )
    return folder


def test_shards_in_any_order_make_the_same_dataset_and_each_frame_is_rendered_once(hall, tmp_path, monkeypatch):
    rendered = []
    operator = RenderFile.render
    monkeypatch.setattr(
        RenderFile, "render", lambda self, layer, **more: rendered.append(layer) or operator(self, layer, **more)
    )
    preset = hall / "hall.yaml"
    alone = files_made(preset, tmp_path / "alone")
    assert len(rendered) == 2  # of two frames in three settings, colour and depth together
    backwards = workers_here(preset, tmp_path / "two", order=lambda shards: shards[::-1])
    assert files_made(preset, tmp_path / "two", jobs=2, workers=backwards) == alone
    assert not (hall / "ran").exists()
    camera = json.loads(alone["manifest.json"])["camera"]
    assert (camera["width_px"], camera["near_m"], camera["far_m"]) == (48, pytest.approx(0.1), 1000)


def test_instances_have_their_objects_names_those_of_libraries_too(hall, tmp_path):
    preset = hall / "objects.yaml"
    output = "output: {layout: tum, modalities: [instance, normal], formats: {instance: npy}}"
    preset.write_text((hall / "hall.yaml").read_text().replace("output: {image: png}", output))
    files = files_made(preset, tmp_path / "out")
    told = [{"id": 1, "name": "Ball [shelf.blend]", "pass_index": 0}, {"id": 2, "name": "Wall", "pass_index": 0}]
    assert json.loads(files["fog/hall/instance.json"]) == {"void": 0, "objects": told}
    ids = np.load(tmp_path / "out/clean/hall/instance/000001.npy")
    assert (ids.dtype, set(np.unique(ids))) == (np.uint16, {1, 2})


def test_flow_of_whole_runs_and_of_shards_and_of_faster_motion(hall, tmp_path):
    preset = hall / "flow.yaml"
    preset.write_text(
        "scenes: [{name: hall, blend: hall.blend, frames: '1:5'}]\n"
        "settings: [{name: clean}, {name: fast, perturb: [{faster_motion: {factor: 2}}]}]\n"
        "render: {backend: reference}\noutput: {image: png, modalities: [depth, flow], formats: {flow: npy}}\n"
    )
    alone = files_made(preset, tmp_path / "alone")
    flows = {
        name: [np.load(file) for file in sorted((tmp_path / f"alone/{name}/hall/flow").iterdir())]
        for name in ("clean", "fast")
    }
    assert [len(item) for item in flows.values()] == [5, 3]
    assert all((item[-1] == [0, 0, 3]).all() for item in flows.values())
    # What does not leave the image and is not hidden goes as far in one step of two as in two of one.
    first, second, both = flows["clean"][0], flows["clean"][1], flows["fast"][0]
    y, x = np.nonzero(both[..., 2] == 0)
    to = np.rint(np.stack([y, x]) + first[y, x, 1::-1].T).astype(int)
    rest = second[to[0].clip(0, 35), to[1].clip(0, 47), :2]  # of the pixel nearest to where it is on the way
    assert np.median(np.abs(first[y, x, :2] + rest - both[y, x, :2])) < 0.1
    assert np.median(np.abs(both[y, x, :2])) > 1
    backwards = workers_here(preset, tmp_path / "two", order=lambda shards: shards[::-1])
    assert files_made(preset, tmp_path / "two", jobs=2, workers=backwards) == alone


def test_a_single_frame_takes_motion_and_shutters(hall, tmp_path):
    (hall / "still.yaml").write_text(
        "scenes: [{name: hall, blend: hall.blend, frames: '2:2'}]\n"
        "settings: [{name: clean}, {name: fast, perturb: [{faster_motion: {factor: 3}}]},\n"
        "  {name: rolling, perturb: [{rolling_shutter: {readout_ms: 5}}]},\n"
        "  {name: blur, perturb: [{camera_motion_blur: {shutter_ms: 10}}]}]\n"
        "render: {backend: reference}\noutput: {image: png}\n"
    )
    files = files_made(hall / "still.yaml", tmp_path / "out")
    for setting in ("fast", "rolling", "blur"):
        assert sum(name.startswith(f"{setting}/hall/results/") for name in files) == 2
        assert files[f"{setting}/hall/traj.txt"] == files["clean/hall/traj.txt"]


def plan_of(hall, **keys):
    path = hall / "other.yaml"
    path.write_text(json.dumps({"scenes": [{"name": "hall", "blend": "hall.blend", "frames": "1:2", **keys}]}))
    return planned(path)


def test_files_are_hashed_and_named_where_missing(hall):
    source = plan_of(hall).scenes[0].source
    before = source.hashes()
    assert before["blend_files"] == "paint.png, shelf.blend"
    assert source.stamps_s.tolist() == [0.0, 0.04]
    paint = hall / "paint.png"
    content = paint.read_bytes()
    paint.write_bytes(content + b"\0")
    after = source.hashes()
    assert {name for name in before if before[name] != after[name]} == {"blend_files_sha256"}
    paint.unlink()
    with pytest.raises(InputError, match=r"scenes\.0\.blend: hall\.blend: misses Image paint \(.*paint\.png\); "):
        plan_of(hall)
    paint.write_bytes(content)


def test_a_file_of_poses_drives_the_camera_and_its_stamps_the_scene(hall):
    (hall / "path.txt").write_text(
        "1305031102.1 0 0 0 0.70710678 0 0 -0.70710678\n"
        "1305031102.14 0.1 0 0 0.70710678 0 0 -0.70710678\n"
        "1305031102.1601 0.2 0 0 0.70710678 0 0 -0.70710678\n"
    )
    source = plan_of(hall, frames="3:9", trajectory="path.txt").scenes[0].source
    assert np.abs(np.array(source.scene_frames) - [3, 4, 4.5025]).max() < 1e-4
    assert source.scene_frames[1] == 4
    assert source.trajectory().c2w[1, :3, 3].tolist() == [0.1, 0, 0]


def test_a_preset_says_engine_and_samples_only_where_it_gives_them(hall):
    path = hall / "rendered.yaml"
    scenes = [{"name": "hall", "blend": "hall.blend", "frames": "1:2"}]
    for render, found in (
        ({}, ("cycles", 2)),
        ({"samples": 1}, ("cycles", 1)),
        ({"engine": "workbench"}, ("workbench", 8)),
        ({"engine": "eevee", "samples": 3}, ("eevee", 3)),
    ):
        path.write_text(json.dumps({"scenes": scenes, "render": render}))
        own = planned(path).scenes[0].source.capabilities.own
        assert (own.engine, own.samples) == found
    path.write_text(json.dumps({"scenes": scenes, "render": {"engine": "embree"}}))
    with pytest.raises(InputError, match=r"render\.engine: is embree, which knows no lights or materials"):
        planned(path)
