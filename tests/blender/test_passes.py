# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes of a scene of one's own beside its frames: one multilayer EXR, read by OpenEXR and by Blender."""

import hashlib
import io
import json

import bpy
import numpy as np
import OpenEXR
import pytest
import yaml
from own_scenes import new_scene, opened, save
from refusals import refused
from runs import files_made, planned
from worlds import write_world

LAYER = "ViewLayer"


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    scene = new_scene()
    layer = scene.view_layers[0]
    layer.use_pass_normal = layer.use_pass_diffuse_color = True
    layer.pass_cryptomatte_depth = 4
    return save(tmp_path_factory.mktemp("passes"))


def layers_of(data):
    """The channels (H, W) and the header of an EXR, by OpenEXR."""
    with OpenEXR.File(io.BytesIO(data), separate_channels=True) as file:
        return {name: item.pixels.copy() for name, item in file.channels().items()}, dict(file.header())


def murmur3_32(text):
    """MurmurHash3 x86 32, seed 0, as Cryptomatte's specification asks for; by Appleby's description."""
    data, value = text.encode(), 0

    def rotated(number, bits):
        return ((number << bits) | (number >> (32 - bits))) & 0xFFFFFFFF

    for start in range(0, len(data) & ~3, 4):
        part = int.from_bytes(data[start : start + 4], "little") * 0xCC9E2D51 & 0xFFFFFFFF
        value = (rotated(value ^ (rotated(part, 15) * 0x1B873593 & 0xFFFFFFFF), 13) * 5 + 0xE6546B64) & 0xFFFFFFFF
    if rest := data[len(data) & ~3 :]:
        part = int.from_bytes(rest, "little") * 0xCC9E2D51 & 0xFFFFFFFF
        value ^= rotated(part, 15) * 0x1B873593 & 0xFFFFFFFF
    value ^= len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35), (16, 1)):
        value = ((value ^ (value >> shift)) * factor) & 0xFFFFFFFF
    return value


def matte(channels, prefix, name):
    """How much of each pixel an object covers, by the ranks of Cryptomatte: an id and its coverage, twice a layer."""
    id_ = np.array(murmur3_32(name), np.uint32).view(np.float32)
    ranks = [(a, b) for number in range(2) for a, b in (("r", "g"), ("b", "a"))]
    found = 0
    for place, (of_id, covers) in enumerate(ranks):
        layer = f"{prefix}{place // 2:02}"
        found = found + np.where(channels[f"{layer}.{of_id}"] == id_, channels[f"{layer}.{covers}"], 0)
    return found


def test_passes_are_those_of_the_frame_and_cryptomatte_knows_its_objects(hall):
    with opened(hall) as (session, paths, _):
        alone = session.frame(paths.request(3))
        assert alone.image("passes") is None
    with opened(hall, others={"passes", "instance"}) as (session, paths, _):
        frame = session.frame(paths.request(3))
        again = session.frame(paths.request(3))
    assert np.array_equal(frame.rgb, alone.rgb)  # which are as they are without
    assert np.array_equal(frame.depth_m, alone.depth_m)
    data = frame.image("passes").tobytes()
    assert data == again.image("passes").tobytes()
    channels, header = layers_of(data)
    assert {name.split(".")[0] for name in channels} == {LAYER}
    assert {name.split(".")[1] for name in channels} >= {
        *("Combined", "Depth", "Normal", "Diffuse Color"), *("CryptoObject00", "CryptoObject01", "CryptoMaterial00"),
    }  # fmt: skip
    colour = np.stack([channels[f"{LAYER}.Combined.{part}"] for part in "RGB"], -1)
    assert np.array_equal(np.maximum(colour, 0), frame.light.rgb)
    assert not {"Date", "RenderTime"} & set(header)
    (key,) = [name for name, text in header.items() if isinstance(text, str) and text == f"{LAYER}.CryptoObject"]
    manifest = json.loads(header[key.replace("/name", "/manifest")])
    for name, number in (("Wall", 2), ("Ball", 1)):
        assert int(manifest[name], 16) == murmur3_32(name)
        covered, seen = matte(channels, f"{LAYER}.CryptoObject", name), frame.image("instance") == number
        assert (covered[seen] > 0.1).mean() > 0.97  # the centre of a pixel may be on an edge
        assert (covered[~seen] < 0.9).mean() > 0.97
        assert 0 < seen.sum() < seen.size


def test_a_dataset_has_them_beside_its_frames_once_for_all_settings(hall, tmp_path):
    preset = hall.parent / "passes.yaml"
    preset.write_text(
        "scenes: [{name: hall, blend: hall.blend, frames: '1:2'}]\n"
        "settings: [{name: clean}, {name: noise, perturb: [{gaussian_noise: {severity: 1}}]}]\n"
        "render: {backend: reference}\noutput: {image: png, modalities: [rgb, depth, passes], depth_range: scene}\n"
    )
    plan = planned(preset)
    assert (plan.reach.farthest_m, plan.format.depth_scale_per_m) == (1000, 50)  # Clip End; 65.535 steps a metre
    files = files_made(preset, tmp_path / "out")
    names = [name for name in files if name.endswith(".exr")]
    assert len(names) == 4
    clean, noise = (sorted(name for name in names if name.startswith(setting)) for setting in ("clean", "noise"))
    assert [files[name] for name in clean] == [files[name] for name in noise]
    assert files[clean[0]] != files[clean[1]]
    image = bpy.data.images.load(str(tmp_path / "out" / clean[0]))
    assert len(image.pixels) == 0  # which reads it: several layers have no pixels of their own
    assert image.type == "MULTILAYER"
    tree = bpy.data.node_groups.new("reader", "CompositorNodeTree")
    mattes = tree.nodes.new("CompositorNodeCryptomatteV2")
    mattes.source, mattes.image = "IMAGE", image
    assert mattes.layer_name == f"{LAYER}.CryptoObject"
    line = json.loads(files["clean/hall/frames.jsonl"].splitlines()[0])
    assert line["sha256"]["passes/000000.exr"] == hashlib.sha256(files[clean[0]]).hexdigest()


def test_what_has_no_passes_is_refused(hall, tmp_path):
    world = write_world(tmp_path, output={"modalities": ["rgb", "passes"]})
    refused(planned, world, names=["passes", "scenes of one's own", "output.modalities"])
    preset = {
        "scenes": [{"name": "hall", "blend": str(hall), "frames": "1:2"}], "render": {"backend": "reference"},
        "output": {"modalities": ["rgb", "passes"]},
    }  # fmt: skip
    lens = {"width": 48, "height": 36, "fx": 40, "fy": 40, "cx": 23.5, "cy": 17.5, "distortion": {"k1": -0.1}}
    rolling = [{"name": "rolling", "perturb": [{"rolling_shutter": {"readout_ms": 20}}]}]
    for number, (more, name) in enumerate((({"camera": lens}, "distorts"), ({"settings": rolling}, "no passes"))):
        file = tmp_path / f"{number}.yaml"
        file.write_text(yaml.safe_dump(preset | more))
        refused(planned, file, names=["passes", name])
