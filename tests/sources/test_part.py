# SPDX-License-Identifier: GPL-3.0-or-later
"""A part of a preset by names and globs, and the folder that its scenes lie in."""

import shutil
import sys
import threading

import fake_session
from cases import cases
from refusals import refused
from worlds import content, path_poses, write_box_ply, write_replica, write_world


from noisy_world.preset.keys import read_preset
from noisy_world.core.progress import PlainProgress
from noisy_world.sources.replica_scenes import REPLICA_SCENES
from noisy_world.dataset.run import Run
from noisy_world.dataset.plan import make_plan

SETTINGS = [{"name": "clean"}, {"sweep": {"perturb": ["fog", "frost"], "severities": [1, 3]}}]
EVERYWHERE = ["clean", "fog_s1", "fog_s3", "frost_s1", "frost_s3"]


def write_scenes(folder, count=3):
    scenes = [{"name": f"box{k}", "mesh": "mesh.ply", "trajectory": "traj.txt"} for k in range(count)]
    return write_world(folder, scenes=scenes, settings=SETTINGS, frames=2)


def parts(preset, **part):
    plan = make_plan(read_preset(preset, **part))
    return [scene.name for scene in plan.scenes], [setting.name for setting in plan.settings]


@cases(
    ("part", "scenes", "settings"),
    [
        ({}, ["box0", "box1", "box2"], EVERYWHERE),
        ({"scenes": ["box1"]}, ["box1"], EVERYWHERE),
        ({"scenes": ["box2,box0"]}, ["box0", "box2"], EVERYWHERE),
        ({"scenes": ["box[12]"], "settings": ["fog*, clean"]}, ["box1", "box2"], ["clean", "fog_s1", "fog_s3"]),
        ({"settings": ["*_s1", "frost*"]}, ["box0", "box1", "box2"], ["fog_s1", "frost_s1", "frost_s3"]),
    ],
)
def test_globs_choose_in_the_presets_order(tmp_path, part, scenes, settings):
    assert parts(write_scenes(tmp_path), **part) == (scenes, settings)


@cases(
    ("part", "named"),
    [
        ({"settings": ["clean,fgo*"]}, ("only.settings: 'fgo*'", "none of 5 ", ": fog_s1, frost_s1")),
        ({"scenes": ["Box0"]}, ("only.scenes: 'Box0'", "none of 3 scenes", ": box0")),
        ({"scenes": ["kitchen"]}, ("only.scenes: 'kitchen'", "none of 3 scenes", ": box0, box1, box2")),
        ({"scenes": [""]}, ("only.scenes: ''", "none of 3 scenes", ": box0, box1, box2")),
    ],
)
def test_a_glob_that_matches_nothing_is_refused_with_near_names(tmp_path, part, named):
    assert refused(parts, write_scenes(tmp_path), **part, names=named).endswith(named[-1])


def test_files_of_scenes_that_are_not_wanted_may_be_missing(tmp_path):
    preset = write_scenes(tmp_path)
    shutil.copy(tmp_path / "mesh.ply", tmp_path / "other.ply")
    overrides = ["scenes.1.mesh=none.ply"]
    refused(make_plan, read_preset(preset, overrides), names=("scenes.1.mesh: ", "none.ply"))
    assert len(make_plan(read_preset(preset, overrides, scenes=["box0", "box2"])).scenes) == 2


def test_a_part_has_the_identity_of_the_whole(tmp_path):
    preset = write_scenes(tmp_path)
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for name in ("mesh.ply", "traj.txt"):
        shutil.copy(tmp_path / name, moved / name)
    whole, part = read_preset(preset), read_preset(preset, data=moved, settings=["clean"])
    assert part.sha256 == whole.sha256
    assert part.described == whole.described
    (scene,) = {scene.source.location.removesuffix("/mesh.ply") for scene in make_plan(part).scenes}
    assert scene == str(moved)


def test_a_part_grows_into_the_whole_to_the_byte(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    preset = write_scenes(tmp_path / "world", count=2)

    def make(out, **part):
        Run(
            make_plan(read_preset(preset, **part)), out, progress=PlainProgress(sys.stderr), stop=threading.Event()
        ).make_dataset()

    make(tmp_path / "whole")
    for part in ({"scenes": ["box1"], "settings": ["frost*,clean"]}, {"settings": ["fog_s3"]}, {}):
        make(tmp_path / "grown", **part)
    assert content(tmp_path / "grown") == content(tmp_path / "whole")


def test_a_folder_of_data_that_is_not_there_is_named(tmp_path):
    folder = tmp_path / "none"
    preset = read_preset(write_scenes(tmp_path), data=folder)
    refused(make_plan, preset, names=("scenes.0.mesh: ", f"{folder}/mesh.ply; ", f"to data, {folder}"))


# --- Replica ---


def write_tree(folder, meshes="{own}/mesh.ply", paths="{scene}/traj.txt", scenes=REPLICA_SCENES, frames=2):
    """A tree as people have Replica, of boxes."""
    for scene in scenes:
        for template in (meshes, paths):
            file = folder / template.format(scene=scene, own=f"{scene[:-1]}_{scene[-1]}")
            file.parent.mkdir(parents=True, exist_ok=True)
            if template is meshes:
                write_box_ply(file)
            else:
                write_replica(file, path_poses(frames))
    return folder


def replica_preset(folder, **scene):
    return write_world(folder, scenes=[{"replica": "*", **scene}])


@cases(
    ("meshes", "paths"),
    [
        ("{own}/mesh.ply", "{scene}/traj.txt"),
        ("{scene}_mesh.ply", "{scene}/traj.txt"),
        ("replica_v1/{own}/mesh.ply", "Replica/{scene}/traj.txt"),
        ("Replica/{scene}_mesh.ply", "Replica/{scene}/traj.txt"),
    ],
)
def test_replica_is_found_as_people_have_it(tmp_path, meshes, paths):
    data = write_tree(tmp_path / (meshes + paths).replace("/", "-"), meshes, paths)
    plan = make_plan(read_preset(replica_preset(tmp_path / "p"), data=data))
    assert [scene.name for scene in plan.scenes] == list(REPLICA_SCENES)
    for scene in plan.scenes:
        own = f"{scene.name[:-1]}_{scene.name[-1]}"
        assert scene.source.location == str(data / meshes.format(scene=scene.name, own=own))
        assert scene.source.path_file == data / paths.format(scene=scene.name)
        assert scene.frame_count == 2


def test_the_downloads_mesh_comes_before_the_copy(tmp_path):
    data = write_tree(tmp_path / "data", "b/{own}/mesh.ply")
    write_tree(data, "a/{scene}_mesh.ply", "{scene}/traj.txt")
    (scene, *_) = make_plan(read_preset(replica_preset(tmp_path / "p"), data=data)).scenes
    assert scene.source.location == str(data / "b/room_0/mesh.ply")


def test_all_that_is_missing_is_said_at_once(tmp_path):
    data = write_tree(tmp_path / "data", scenes=("room0", "office1", "office2"))
    (data / "office1/traj.txt").unlink()
    preset = replica_preset(tmp_path / "p")
    chosen = read_preset(preset, data=data, scenes=["office[0-2],room*"])
    lacking = ("mesh of room1, room2, office0 (room_1/mesh.ply or ", "path of room1, room2, office0, office1 (room1/")
    refused(make_plan, chosen, names=(f"{preset}: data: in {data} ", *lacking, "--data DIR", "--scenes"))
    assert parts(preset, data=data, scenes=["room0", "office2"])[0] == ["room0", "office2"]


def test_two_copies_are_not_chosen_between(tmp_path):
    data = write_tree(tmp_path / "data", "a/{own}/mesh.ply")
    write_tree(data, "b/{own}/mesh.ply")
    preset = read_preset(replica_preset(tmp_path / "p"), data=data)
    refused(make_plan, preset, names=("data: room0 ", "/a/room_0/mesh.ply and ", "/b/room_0"))


def test_a_path_of_ones_own_goes_with_replicas_meshes(tmp_path):
    data = write_tree(tmp_path / "data")
    for scene in REPLICA_SCENES:
        (data / scene / "traj.txt").unlink()
    preset = replica_preset(tmp_path / "p", replica="room_*", name="mine_*", trajectory={"handheld": {"frames": 7}})
    plan = make_plan(read_preset(preset, data=data))
    assert [(scene.name, scene.frame_count) for scene in plan.scenes] == [(f"mine_room{k}", 7) for k in range(3)]


def test_keys_of_the_trajectory_go_with_replicas_path(tmp_path):
    data = write_tree(tmp_path / "data", frames=6)
    preset = replica_preset(tmp_path / "p", replica="office0", trajectory={"every": 2})
    assert make_plan(read_preset(preset, data=data)).frame_count == 3


@cases(
    ("scene", "data", "named"),
    [
        ({"replica": "rom0"}, "data", ("scenes.0.replica: ", "'rom0'", "'room0'")),
        ({"mesh": "a.ply"}, "data", ("scenes.0: names mesh and replica", "one of mesh, replica,")),
        ({"name": "one"}, "data", ("scenes.0.name: is 'one'", "8 scenes")),
        ({}, "none", ("data: no such folder: ", "/none; ", "--data DIR")),
    ],
)
def test_what_is_refused_of_replica(tmp_path, scene, data, named):
    preset = replica_preset(tmp_path / "p", **scene)
    write_tree(tmp_path / "data")
    refused(lambda: make_plan(read_preset(preset, data=tmp_path / data)), names=named)
