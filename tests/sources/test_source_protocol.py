# SPDX-License-Identifier: GPL-3.0-or-later
"""A source that nothing knows of goes through the whole pipeline: it is asked for what the protocol says alone."""

import hashlib
import json
import sys
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace

import cv2
import fake_session
import numpy as np
import pytest
from refusals import refused
from shard_workers import workers_here
from worlds import path_poses, write_world

from noisy_world.core.errors import StorageError
from noisy_world.dataset.plan import lay_out_plan, read_settings
from noisy_world.dataset.shards import Shard
from noisy_world.sources.scene_kinds import Scene, SceneEntry, SourceKind
from noisy_world.render.source import SimpleSource
from noisy_world.render.source import ColourAndDepth, SourceCapabilities
from noisy_world.preset.keys import read_preset
from noisy_world.preset.scene_keys import SceneKeys
from noisy_world.core.progress import PlainProgress
from noisy_world.core.trajectory import Trajectory
from noisy_world.perturbations import registry
from noisy_world.dataset.run import Run
from noisy_world.dataset.plan import make_plan
from noisy_world.sources.lit_scene import BlendSource

STAMPS_S = np.array([10.0, 10.5, 11.5, 12.0])


@dataclass(frozen=True)
class ArithmeticFrame(ColourAndDepth):
    rgb: np.ndarray
    depth_m: np.ndarray

    def file_as(self, modality, format_):
        return None


class ArithmeticSource(SimpleSource):
    """Frames whose colour tells their time, and whose depth tells where the camera is."""

    location = "arithmetic"
    capabilities = SourceCapabilities(rendered=False, any_pose=True)
    robot_axes = "opencv"

    def __init__(self):
        self.notes = []

    def trajectory(self):
        return Trajectory(path_poses(4), STAMPS_S)

    def hashes(self):
        return {"arithmetic": "1"}

    @contextmanager
    def prepare(self, camera, note):
        note("prepared")
        self.camera_seen = camera
        yield self

    def open(self, paths, options, note):
        note("opened")
        return self

    def frame(self, request):
        shape = (self.camera_seen.height_px, self.camera_seen.width_px)
        rgb = np.full((*shape, 3), request.time_s / 20, dtype=np.float32)
        return ArithmeticFrame(rgb, np.full(shape, 5 + request.depth_c2w[0, 3], dtype=np.float32))


def run_of(plan, out, **options):
    return Run(plan, out, progress=PlainProgress(sys.stderr), stop=threading.Event(), **options)


def test_a_new_kind_of_source_is_rendered_moved_and_written(tmp_path, capfd):
    moved = {"name": "moved", "perturb": [{"motion_deviation": {"rotation_deg": 0, "translation_m": 0.1}}]}
    late = {"name": "late", "perturb": [{"desync": {"offset": 1}}]}
    rig = {"rgb": {}, "depth": {"translation_m": [0.5, 0, 0]}}
    path = write_world(tmp_path / "world", size=(8, 6), rig=rig, settings=[{"name": "clean"}, moved, late])
    preset = read_preset(path)
    scene = Scene("sums", preset.place("scenes.0"), ArithmeticSource())
    plan = lay_out_plan(preset, read_settings(preset, registry()), [scene])
    assert not plan.needs_blender
    out = tmp_path / "out"
    run_of(plan, out).make_dataset()
    said = capfd.readouterr().err
    assert said.count("prepared") == 1, "one scene, for two renders"
    assert [line for line in ("sums: opened", "sums@moved: opened") if line not in said] == []
    for setting in ("clean", "moved", "late"):
        robot = np.loadtxt(out / setting / "sums/traj_robot.txt").reshape(-1, 4, 4)
        depth_x_m = (robot @ [0.5, 0, 0, 1])[:, 0]  # the depth sensor's place on the robot
        for k in range(4):
            folder = out / setting / "sums/results"
            rgb = cv2.imread(str(folder / f"frame{k:06d}.png"))
            assert (rgb == round(STAMPS_S[k] / 20 * 255)).all()
            depth = cv2.imread(str(folder / f"depth{k:06d}.png"), cv2.IMREAD_UNCHANGED)
            taken = min(k + 1, 3) if setting == "late" else k
            assert np.abs(depth / 6553.5 - (5 + depth_x_m[taken])).max() < 1e-4
    moved_m = np.loadtxt(out / "moved/sums/traj_robot.txt")[:, [3, 7, 11]]
    assert 0.02 < np.abs(moved_m - path_poses(4)[:, :3, 3]).mean() < 0.3
    scenes = json.loads((out / "manifest.json").read_text())["identity"]["scenes"]
    assert {name: scene["inputs"] for name, scene in scenes.items()} == {"sums": {"arithmetic": "1"}}


class FlatSource(ArithmeticSource):
    """Frames without depth, from the path's own poses alone."""

    capabilities = SourceCapabilities(rendered=False, any_pose=False, depth=False)


class SlideKind(SourceKind):
    name, label, meaning, keys = "slide", "Slide", "a flat one", SceneKeys
    remedies = {"depth": "paint it"}

    def scenes(self, entry):
        return []


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ({}, ("scenes.0.slide: ", "output.modalities", "paint it, or")),
        (
            {"settings": [{"name": "s", "perturb": [{"fog_depth": None}]}], "output": {"modalities": ["rgb"]}},
            ("scenes.0.slide: ", "needs depth", "paint it, or"),
        ),
        (
            {"settings": [{"name": "s", "perturb": [{"motion_deviation": None}]}], "output": {"modalities": ["rgb"]}},
            ("scenes.0.slide: ", "be seen from elsewhere"),
        ),
        ({"rig": {"rgb": {}}}, ("scenes.0.slide: ", "poses for a rig")),
    ],
)
def test_messages_name_the_key_that_the_source_says(tmp_path, keys, told):
    preset = read_preset(write_world(tmp_path, size=(8, 6), **keys))
    place = preset.place("scenes.0")
    scene = Scene("sums", place, FlatSource(), SceneEntry(preset, place, SlideKind(), SceneKeys()))
    refused(lay_out_plan, preset, read_settings(preset, registry()), [scene], names=told)


def test_a_blend_with_several_cameras_has_instants_only():
    found = SimpleNamespace(
        known_path=None,
        found=SimpleNamespace(camera="a"),
        _cameras=("a", "b"),
        rendering=None,
        _objects=None,
        _at_once="",
    )
    capabilities = BlendSource.capabilities.fget(found)
    assert capabilities.instants_only.startswith("2 cameras take turns")


@pytest.fixture
def _fake_blender(monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)


@pytest.mark.usefixtures("_fake_blender")
@pytest.mark.parametrize("changed", ["mesh.ply", "traj.txt", "preset.yaml", None])
def test_a_worker_refuses_a_run_that_was_opened_otherwise(tmp_path, changed):
    path = write_world(tmp_path / "world", frames=4, size=(8, 6))
    out = tmp_path / "out"

    def change():
        if changed == "preset.yaml":
            path.write_text(path.read_text().replace("seed: 3", "seed: 4"))
        elif changed:
            file = path.parent / changed
            file.write_text(
                file.read_text().replace("200", "201") if changed == "mesh.ply" else file.read_text() + "\n"
            )

    workers = workers_here(path, out, before=change)
    run = run_of(make_plan(read_preset(path)), out, jobs=2, workers=workers)
    if changed is None:
        run.make_dataset()
        return
    refused(run.make_dataset, names=(str(out), "another identity"), error=StorageError)
    assert not out.exists(), "nothing was made, so nothing stays"


@pytest.mark.usefixtures("_fake_blender")
def test_a_worker_without_a_run_is_refused(tmp_path):
    path = write_world(tmp_path / "world", frames=1, size=(8, 6))
    work, progress = workers_here(path, tmp_path / "out"), PlainProgress(sys.stderr)
    refused(work, [Shard("box", 0, 1)], print, progress, names="no run is open", error=StorageError)


def test_a_recordings_hash_follows_every_file(tmp_path):
    world = write_world(tmp_path / "world", frames=2, size=(8, 6))
    folder = tmp_path / "kept" / "box"
    (folder / "results").mkdir(parents=True)
    for k in range(2):
        cv2.imwrite(str(folder / f"results/frame{k:06d}.png"), np.full((6, 8, 3), k, np.uint8))
        cv2.imwrite(str(folder / f"results/depth{k:06d}.png"), np.full((6, 8), 1000 + k, np.uint16))
    (folder / "traj.txt").write_bytes((world.parent / "traj.txt").read_bytes())
    world.write_text(
        world.read_text().replace("mesh: mesh.ply", f"sequence: {folder}").replace("  trajectory: traj.txt\n", "")
    )

    def hashes():
        (scene,) = make_plan(read_preset(world)).scenes
        return scene.source.hashes()

    files = sorted((folder / "results").iterdir(), key=lambda path: (not path.name.startswith("frame"), path.name))
    each = "".join(hashlib.sha256(path.read_bytes()).hexdigest() for path in files)
    assert hashes()["sequence_sha256"] == hashlib.sha256(each.encode()).hexdigest()
    before = hashes()
    cv2.imwrite(str(folder / "results/depth000001.png"), np.full((6, 8), 1, np.uint16))
    assert hashes() != before
