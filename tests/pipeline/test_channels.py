# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets with channels beside colour and depth: what is written, kept, packed and refused."""

import json

import cv2
import numpy as np
import pytest
from refusals import refused
import yaml

pytest.importorskip("embreex", reason="embreex is not installed: pip install '.[embree]'")

from cases import cases
from worlds import path_poses, with_objects, write_world
from runs import run

from noisy_world.layouts import LAYOUTS
from noisy_world.core.errors import NoisyWorldError, StorageError
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan
from noisy_world.dataset.opening import open_path

RAYS = {"engine": "embree", "samples": 1, "backend": "reference"}
SETTINGS = [
    {"name": "clean"},
    {"name": "fog", "perturb": [{"fog": {"severity": 3}}]},
    {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 1}}]},
]
ALL = ["rgb", "depth", "normal"]


def images(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*.png"))}


def walls(c2w, size):
    """The normals (H, W, 3) of the box room's walls in camera axes, by which wall a ray meets first."""
    width, height = size
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    ray = (
        np.stack([(u - (width - 1) / 2), (v - (height - 1) / 2), np.full(u.shape, width / 2)], axis=-1) @ c2w[:3, :3].T
    )
    to_wall = np.where(ray > 0, np.array([2.0, 1.5, 2.5]) - c2w[:3, 3], np.array([-2.0, -1.5, 0.0]) - c2w[:3, 3])
    axis = (to_wall / ray).argmin(axis=-1)
    world = -np.sign(np.take_along_axis(ray, axis[..., None], -1)) * np.eye(3)[axis]
    return world @ c2w[:3, :3]


@cases("layout", LAYOUTS)
def test_normals_lie_beside_what_was_there_without_them(layout, tmp_path):
    keys = {"render": RAYS, "settings": SETTINGS}
    tmp_path /= layout
    output = {"layout": layout, "image": "png"}
    plain = write_world(tmp_path / "plain", output=output, **keys)
    more = write_world(tmp_path / "more", output={**output, "modalities": ALL}, **keys)
    run(plain, tmp_path / "a")
    run(more, tmp_path / "b")
    before, after = images(tmp_path / "a"), images(tmp_path / "b")
    beside = {path: data for path, data in after.items() if path not in before}
    assert {path: after[path] for path in before} == before
    assert len(beside) == 6 + 6 + 3 + 6
    assert all("normal" in str(path.parent) for path in beside)

    poses = path_poses(6)
    for setting, sources in (("clean", range(6)), ("fog", range(6)), ("fast", (0, 2, 4)), ("late", range(6))):
        here = [data for path, data in sorted(beside.items()) if path.parts[0] == setting]
        for data, source in zip(here, sources, strict=True):
            steps = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)[..., ::-1]
            assert steps.dtype == np.uint16
            expected = walls(poses[source], (64, 48))
            wrong = np.abs(steps / 65535 * 2 - 1 - expected).max(axis=-1) > 2e-5
            edges = np.abs(cv2.Laplacian(expected, cv2.CV_64F)).max(axis=-1) > 1e-6
            assert not (wrong & ~cv2.dilate(edges.astype(np.uint8), np.ones((3, 3))).astype(bool)).any()

    manifest = json.loads((tmp_path / "b/manifest.json").read_text())
    assert "camera's axes" in manifest["conventions"]["normal"]
    assert "normal" not in json.loads((tmp_path / "a/manifest.json").read_text())["conventions"]
    assert run(more, tmp_path / "b").frames_rendered == 0


def test_a_lost_normal_is_made_again_and_overwriting_leaves_none(tmp_path):
    output = {"layout": "replica", "image": "png"}
    keys = {"render": RAYS, "settings": SETTINGS[:2]}
    preset = write_world(tmp_path / "world", output={**output, "modalities": ["normal"]}, **keys)
    out = tmp_path / "out"
    run(preset, out)
    before = images(out)
    assert {path.parent.name for path in before} == {"normal"}
    (out / "fog/box/normal/000003.png").unlink()
    (out / "clean/box/normal/000004.png").write_bytes(b"no image")
    assert run(preset, out).frames_rendered == 2
    assert images(out) == before
    run(write_world(tmp_path / "world", output=output, **keys), out, overwrite=True)
    assert not list(out.rglob("normal"))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"output": {"modalities": ["rgb", "normals"]}}, ["output.modalities", "'normals'", "did you mean 'normal'"]),
        (
            {"output": {"modalities": ALL}, "render": {**RAYS, "engine": "eevee"}},
            ["normal", "eevee", "cycles or embree"],
        ),
        ({"output": {"modalities": ["normal", "normal"]}}, ["output.modalities", "each once"]),
    ],
)
def test_what_cannot_be_given_is_refused_in_a_line(keys, words, tmp_path):
    preset = write_world(tmp_path, **{"render": RAYS, **keys})
    refused(lambda: make_plan(read_preset(preset)), names=[str(preset), *words])


def test_a_recording_has_no_normals(tmp_path):
    preset = write_world(tmp_path / "world", frames=2, render=RAYS)
    run(preset, tmp_path / "out")
    document = {
        "scenes": [{"name": "again", "sequence": str(tmp_path / "out/clean/box")}],
        "settings": [{"name": "clean"}],
        "output": {"modalities": ALL},
    }
    recorded = tmp_path / "recorded.yaml"
    recorded.write_text(yaml.safe_dump(document))
    refused(make_plan, read_preset(recorded), names="output.modalities: normal: again ")
    assert np.array_equal(open_path(tmp_path / "out")["clean/box"][1].rgb.shape, (48, 64, 3))


def test_instances_have_a_file_of_ids_and_names(tmp_path):
    keys = {"render": RAYS, "output": {"layout": "tum", "modalities": ["rgb", "instance"]}}
    preset, out = write_world(tmp_path / "world", frames=2, **keys), tmp_path / "out"
    refused(make_plan, read_preset(preset), names=["scenes.0.mesh: ", "object_id"])
    with_objects(tmp_path / "world", [300, 7, 7, 65535, -1, 12])
    names = tmp_path / "world/info_semantic.json"
    run(preset, out)
    objects = json.loads((out / "clean/box/instance.json").read_text())
    assert objects == {"void": 0, "objects": [{"id": number, "name": None} for number in (7, 12, 300, 65535)]}
    for path in (out / "clean/box/instance").iterdir():
        ids = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert ids.dtype == np.uint16
        assert set(np.unique(ids)) <= {0, 7, 12, 300, 65535}
        assert len(np.unique(ids)) > 2

    names.write_text(json.dumps({"objects": [{"id": 7, "class_name": "wall"}, {"id": 9, "class_name": "door"}]}))
    refused(lambda: run(preset, out), names=["scenes.0: ", "--overwrite"], error=StorageError)
    run(preset, out, overwrite=True)
    assert json.loads((out / "clean/box/instance.json").read_text())["objects"][0] == {"id": 7, "name": "wall"}
    names.write_text('{"objects": [3]}')
    refused(lambda: run(preset, tmp_path / "other"), names=["info_semantic.json: ", "objects"])
    large = tmp_path / "large"
    preset = write_world(large, frames=2, **keys)
    with_objects(large, [1, 2, 3, 4, 5, 65536])
    refused(lambda: run(preset, tmp_path / "third"), names="object_id 65536", error=NoisyWorldError)


def test_classes_are_those_of_the_objects_and_named(tmp_path):
    keys = {"render": RAYS, "output": {"layout": "replica", "modalities": ["instance", "semantic"]}}
    preset, out = write_world(tmp_path / "world", frames=2, **keys), tmp_path / "out"
    with_objects(tmp_path / "world", [300, 7, 8, 9, -1, 12])
    refused(make_plan, read_preset(preset), names=["scenes.0.mesh: ", "semantic", "info_semantic.json"])
    names = tmp_path / "world/info_semantic.json"
    classes = {300: (93, "wall"), 7: (93, "wall"), 8: (40, "floor"), 9: (-1, "undefined"), 55: (2, "bed")}
    objects = [{"id": number, "class_id": of, "class_name": name} for number, (of, name) in classes.items()]
    names.write_text(json.dumps({"objects": objects, "classes": []}))
    run(preset, out)
    told = json.loads((out / "clean/box/semantic.json").read_text())
    assert told == {"void": 0, "classes": [{"id": 40, "name": "floor"}, {"id": 93, "name": "wall"}]}
    seen = set()
    for path in sorted((out / "clean/box/semantic").iterdir()):
        found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        ids = cv2.imread(str(out / "clean/box/instance" / path.name), cv2.IMREAD_UNCHANGED)
        assert found.dtype == np.uint16
        assert np.array_equal(found, np.where((ids == 300) | (ids == 7), 93, np.where(ids == 8, 40, 0)))
        seen |= set(np.unique(found).tolist())
    assert len(seen) > 1
    for wrong, said in (({"id": 7, "class_name": "wall"}, "class_id"), ({**objects[0], "class_id": 70000}, "70000")):
        names.write_text(json.dumps({"objects": [wrong]}))
        refused(lambda: run(preset, tmp_path / "other"), names=["info_semantic.json: ", said])


def test_an_embedded_room_knows_its_things_and_their_classes(tmp_path):
    document = {
        "scenes": [{"name": "room", "mesh": "embedded:room", "trajectory": {"handheld": {"frames": 2, "rate_hz": 1}}}],
        "camera": {"width": 64, "height": 48, "fx": 32, "fy": 32, "cx": 31.5, "cy": 23.5},
        "render": RAYS,
        "settings": [{"name": "clean"}],
        "output": {"modalities": ["instance", "semantic"]},
    }
    preset, out = tmp_path / "room.yaml", tmp_path / "out"
    preset.write_text(yaml.safe_dump(document))
    run(preset, out)
    things = json.loads((out / "clean/room/instance.json").read_text())["objects"]
    named = {item["id"]: item["name"] for item in json.loads((out / "clean/room/semantic.json").read_text())["classes"]}
    assert {"sofa", "chair", "wall", "floor", "book"} <= set(named.values())
    assert [thing["name"] for thing in things].count("chair") == 4  # about the table
    of_thing = {0: ""} | {thing["id"]: thing["name"] for thing in things}
    seen: set[str] = set()
    for path in sorted((out / "clean/room/instance").iterdir()):
        ids, classes = (
            cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in (path, out / "clean/room/semantic" / path.name)
        )
        pairs = {
            (of_thing[one], {0: "", **named}[other]) for one, other in zip(ids.ravel(), classes.ravel(), strict=True)
        }
        assert all(thing == category for thing, category in pairs)
        assert (ids > 0).mean() > 0.95
        seen |= {category for _, category in pairs}
    assert len(seen) > 3
