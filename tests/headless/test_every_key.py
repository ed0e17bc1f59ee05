# SPDX-License-Identifier: GPL-3.0-or-later
"""Each key of a preset in turn: what decides bytes changes the identity or is refused, and the rest leaves it alone."""

import json
import re
import shutil
from functools import cache

import cv2
import numpy as np
import pytest
from cases import cases
from made_bags import START_NS, STEP_NS, body, walk
from own_scenes import new_scene, save
import recorded_layouts
from worlds import path_poses, write_replica, write_world

from noisy_world.dataset.identity import plain_identity
from noisy_world.core.errors import InputError
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan
from noisy_world.sources import preset_keys, preset_leaves

NOISY = {"name": "noisy", "perturb": [{"gaussian_noise": {"severity": 2}}]}
RIG = {"rgb": {"translation_m": [0, 0, 0.1]}, "depth": {"translation_m": [0, 0.1, 0.1]}}
SEEN = {"translation_m": [0, 0.1, 0.1], "width": 40, "height": 30}
IDENTITY = "[[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
LONG = {"frames": 2000, "speed_m_s": 1.0}
SWEPT = {"perturb": ["faster_motion"], "parameters": {"factor": [2, 3]}, "name": "x{factor}"}
NOISES = {"perturb": ["gaussian_noise"], "severities": [1], "modes": ["static"], "stream": "a"}

SEEN_SO = {"fx": 58.0, "fy": 57.0, "cx": 31.25, "cy": 23.75}
TOLD = {
    "folder": "tum",
    "rgb": {"list": "rgb.txt"},
    "depth": {"list": "depth.txt", "scale_per_m": 5000},
    "poses": "groundtruth.txt",
    "intrinsics": SEEN_SO,
}
COUNTED = {
    "folder": "unstamped",
    "rgb": "results/frame*.jpg",
    "depth": "results/depth*.png",
    "poses": "traj.txt",
    "intrinsics": SEEN_SO,
}

# For each key a preset, and a value that means something else there.
CHANGES = {
    "scenes[].mesh": ("mesh", "scenes.0.mesh=other.ply"),
    "scenes[].up": ("textured", "scenes.0.up=z"),
    "scenes[].light": ("textured", "scenes.0.light=scene"),
    "scenes[].replica": ("replica", "scenes.0.replica=room1"),
    "scenes[].sequence.folder": ("recording", "scenes.0.sequence=other"),
    "scenes[].sequence.bag": ("bag", "scenes.0.sequence.bag=other.bag"),
    "scenes[].sequence.poses.body": ("bag", "scenes.0.sequence.poses.body=base_link"),
    "scenes[].sequence.rgb.files": ("counted", "scenes.0.sequence.rgb='results/frame00000[0-2].jpg'"),
    "scenes[].sequence.rgb.list": ("told", "scenes.0.sequence.rgb.list=fewer.txt"),
    "scenes[].sequence.depth.files": ("counted", "scenes.0.sequence.depth='results/depth00000[0-2].png'"),
    "scenes[].sequence.depth.list": ("told", "scenes.0.sequence.depth.list=fewer_depth.txt"),
    "scenes[].sequence.depth.scale_per_m": ("told", "scenes.0.sequence.depth.scale_per_m=1000"),
    "scenes[].sequence.depth.void[]": ("told", "scenes.0.sequence.depth.void=[1000]"),
    "scenes[].sequence.poses.file": ("counted", "scenes.0.sequence.poses=other.txt"),
    "scenes[].sequence.poses.format": ("counted", "scenes.0.sequence.poses.format=kitti"),
    "scenes[].sequence.poses.pose": ("counted", "scenes.0.sequence.poses.pose=w2c"),
    "scenes[].sequence.poses.axes": ("counted", "scenes.0.sequence.poses.axes=ned"),
    "scenes[].sequence.poses.rate_hz": ("counted", "scenes.0.sequence.poses.rate_hz=10"),
    "scenes[].sequence.poses.stamp_unit": ("timed", "scenes.0.sequence.poses.stamp_unit=ms"),
    "scenes[].sequence.imu": ("told", "scenes.0.sequence.imu=imu.csv"),
    "scenes[].sequence.intrinsics.file": ("told", "scenes.0.sequence.intrinsics=k.txt"),
    **{
        f"scenes[].sequence.intrinsics.{name}": ("told", f"scenes.0.sequence.intrinsics.{name}=40")
        for name in ("fx", "fy", "cx", "cy")
    },
    "scenes[].sequence.stamps.file": ("timed", "scenes.0.sequence.stamps=later.txt"),
    "scenes[].sequence.stamps.names": ("timed", "scenes.0.sequence.stamps.names=true"),
    "scenes[].sequence.stamps.stamp_unit": ("timed", "scenes.0.sequence.stamps.stamp_unit=ms"),
    "scenes[].imu.time_offset_s": ("inertial", "scenes.0.imu.time_offset_s=0.01"),
    "scenes[].imu.clock_drift_ppm": ("inertial", "scenes.0.imu.clock_drift_ppm=50"),
    "scenes[].imu.stamp_jitter_s": ("inertial", "scenes.0.imu.stamp_jitter_s=0.001"),
    "scenes[].imu.dropped_share": ("inertial", "scenes.0.imu.dropped_share=0.5"),
    "scenes[].video": ("video", "scenes.0.video=other.avi"),
    "scenes[].depth": ("video", "scenes.0.depth=depth2"),
    "scenes[].depth_scale_per_m": ("video", "scenes.0.depth_scale_per_m=5000"),
    "scenes[].blend": ("blend", "scenes.0.blend=other.blend"),
    "scenes[].scene": ("blend", "scenes.0.scene=Scene.001"),
    "scenes[].camera": ("blend", "scenes.0.camera=Camera.001"),
    "scenes[].frames": ("blend", "scenes.0.frames='1:3'"),
    "scenes[].compositor": ("blend", "scenes.0.compositor=keep"),
    "scenes[].depth_alpha": ("blend", "scenes.0.depth_alpha=0.3"),
    "scenes[].air.soften_sun": ("sunny", "scenes.0.air.soften_sun=false"),
    "scenes[].air.visibility_m": ("sunny", "scenes.0.air.visibility_m=150"),
    "scenes[].air.path_m": ("sunny", "scenes.0.air.path_m=50"),
    "scenes[].air.reflections": ("sunny", "scenes.0.air.reflections=true"),
    "scenes[].trajectory.file": ("mesh", "scenes.0.trajectory.file=other.txt"),
    "scenes[].trajectory.handheld.frames": ("handheld", "scenes.0.trajectory.handheld.frames=4"),
    "scenes[].trajectory.handheld.rate_hz": ("handheld", "scenes.0.trajectory.handheld.rate_hz=10"),
    "scenes[].trajectory.handheld.seed": ("handheld", "scenes.0.trajectory.handheld.seed=77"),
    "scenes[].trajectory.handheld.speed_m_s": ("handheld", "scenes.0.trajectory.handheld.speed_m_s=0.8"),
    "scenes[].trajectory.handheld.clearance_m": ("handheld", "scenes.0.trajectory.handheld.clearance_m=0.3"),
    "scenes[].trajectory.handheld.revisit": ("long", "scenes.0.trajectory.handheld.revisit=true"),
    "scenes[].trajectory.handheld.wander_m": ("handheld", "scenes.0.trajectory.handheld.wander_m=0.2"),
    "scenes[].trajectory.body.kind": ("carried", "scenes.0.trajectory.body.kind=runner"),
    "scenes[].trajectory.body.motion": ("carried", "scenes.0.trajectory.body.motion=2"),
    "scenes[].trajectory.format": ("mesh", "scenes.0.trajectory.format=kitti"),
    "scenes[].trajectory.pose": ("mesh", "scenes.0.trajectory.pose=w2c"),
    "scenes[].trajectory.axes": ("mesh", "scenes.0.trajectory.axes=opengl"),
    "scenes[].trajectory.rate_hz": ("mesh", "scenes.0.trajectory.rate_hz=10"),
    "scenes[].trajectory.stamp_unit": ("stamped", "scenes.0.trajectory.stamp_unit=ms"),
    "scenes[].trajectory.start": ("mesh", "scenes.0.trajectory.start=1"),
    "scenes[].trajectory.stop": ("mesh", "scenes.0.trajectory.stop=4"),
    "scenes[].trajectory.every": ("mesh", "scenes.0.trajectory.every=2"),
    "scenes[].trajectory.resample_hz": ("mesh", "scenes.0.trajectory.resample_hz=7"),
    "scenes[].rate_hz": ("unstamped", "scenes.0.rate_hz=10"),
    "scenes[].layout": ("plates", "scenes.0.layout=auto"),
    "scenes[].poses": ("lost", "scenes.0.poses=keep"),
    "scenes[].undistort": ("lens", "scenes.0.undistort=true"),
    "scenes[].void": ("recording", "scenes.0.void=sky"),
    "scenes[].register": ("lens", "scenes.0.register=true"),
    "scenes[].distortion.model": ("rebent", "scenes.0.distortion.model=equidistant"),
    **{
        f"scenes[].distortion.{name}": ("rebent", f"scenes.0.distortion.{name}=0.011")
        for name in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
    },
    "scenes[].distortion.undistort": ("rebent", "scenes.0.distortion.undistort=true"),
    "scenes[].name": ("mesh", "scenes.0.name=hut"),
    "seed": ("mesh", "seed=4"),
    "camera.width": ("mesh", "camera.width=60"),
    "camera.height": ("mesh", "camera.height=44"),
    "camera.fx": ("mesh", "camera.fx=33"),
    "camera.fy": ("mesh", "camera.fy=33"),
    "camera.cx": ("mesh", "camera.cx=30"),
    "camera.cy": ("mesh", "camera.cy=20"),
    "camera.device": ("mesh", "camera.device=phone"),
    "camera.near_m": ("mesh", "camera.near_m=0.1"),
    "camera.far_m": ("mesh", "camera.far_m=100"),
    "camera.distortion.model": ("bent", "camera.distortion.model=equidistant"),
    **{
        f"camera.distortion.{name}": ("bent", f"camera.distortion.{name}=0.011")
        for name in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
    },
    "camera.distortion.undistort": ("bent", "camera.distortion.undistort=true"),
    **{
        f"rig.{sensor}.{name}": ("rig", *text)
        for sensor in ("rgb", "depth")
        for name, text in {
            "translation_m": [f"rig.{sensor}.translation_m=[0, 0, 0.3]"],
            "quat_wxyz": [f"rig.{sensor}.quat_wxyz=[0.5, 0.5, 0.5, 0.5]"],
            "rotation_euler_deg": [f"rig.{sensor}.rotation_euler_deg=[-90, 0, 0]"],
            "matrix[]": [f"rig.{sensor}={{matrix: {IDENTITY}}}"],
        }.items()
    },
    **{
        f"rig.imu.{name}": ("felt", f"rig.imu.{name}={value}")
        for name, value in {
            "translation_m": "[0, 0, 0.3]",
            "quat_wxyz": "[0.5, 0.5, 0.5, 0.5]",
            "rotation_euler_deg": "[-90, 0, 0]",
            "device": "adis16448",
            "bandwidth_hz": 50,
            "rate_hz": 100,
            "gravity_m_s2": 1.62,
            "time_offset_s": 0.01,
            "clock_drift_ppm": 5,
            "gyro_noise_density": 1e-4,
            "gyro_random_walk": 1e-5,
            "accel_noise_density": 1e-3,
            "accel_random_walk": 1e-4,
            "gyro_bias_rad_s": "[0.01, 0, 0]",
            "accel_bias_m_s2": "[0.1, 0, 0]",
            "gyro_scale_error": "[0.01, 0, 0]",
            "accel_scale_error": "[0.01, 0, 0]",
            "gyro_misalignment_deg": "[0.1, 0, 0]",
            "accel_misalignment_deg": "[0.1, 0, 0]",
            "gyro_range_deg_s": 500,
            "accel_range_m_s2": 40,
            "gyro_step_deg_s": 0.1,
            "accel_step_m_s2": 0.01,
        }.items()
    },
    "rig.imu.matrix[]": ("felt", f"rig.imu={{matrix: {IDENTITY}}}"),
    "rig.depth.sensor": ("rig", "rig.depth.sensor=choi_2015"),
    **{
        f"rig.depth.{name}": ("seeing", f"rig.depth.{name}={value}")
        for name, value in {
            "width": 50,
            "height": 40,
            "fx": 31,
            "fy": 31,
            "cx": 20,
            "cy": 15,
            "registered": "true",
            "rate_hz": 100,
            "delay_ms": 2,
            "clock_drift_ppm": 40,
        }.items()
    },
    "rig.depth.horizontal_fov_deg": ("wide", "rig.depth.horizontal_fov_deg=65"),
    "render.engine": ("mesh", "render.engine=embree"),
    "render.backend": ("noisy", "render.backend=compositor"),
    "render.device": ("mesh", "render.device=gpu"),
    "render.compositor_device": ("noisy", "render.compositor_device=gpu"),
    "render.samples": ("mesh", "render.samples=4"),
    "render.allow_empty": ("mesh", "render.allow_empty=true"),
    "render.processors": ("mesh", "render.processors=any"),
    "settings[].name": ("noisy", "settings.0.name=loud"),
    "settings[].perturb[]": ("noisy", "settings.0.perturb=[{gaussian_noise: {severity: 3}}]"),
    "settings[].stream": ("noisy", "settings.0.stream=other"),
    "settings[].backend": ("noisy", "settings.0.backend=compositor"),
    "settings[].include": ("included", "settings.0.include=more.yaml"),
    "settings[].sweep.perturb[]": ("noises", "settings.0.sweep.perturb=[fog]"),
    "settings[].sweep.severities[]": ("noises", "settings.0.sweep.severities=[2]"),
    "settings[].sweep.modes[]": ("noises", "settings.0.sweep.modes=[dynamic]"),
    "settings[].sweep.stream": ("noises", "settings.0.sweep.stream=b"),
    "settings[].sweep.parameters": ("swept", "settings.0.sweep.parameters={factor: [2, 4]}"),
    "settings[].sweep.without": ("swept", "settings.0.sweep.without=[{factor: 3}]"),
    "settings[].sweep.name": ("swept", "settings.0.sweep.name='fast{factor}'"),
    "output.layout": ("mesh", "output.layout=tum"),
    "output.image": ("mesh", "output.image=jpg"),
    "output.colour": ("grey", "output.colour=rgb"),
    "output.depth_scale_per_m": ("mesh", "output.depth_scale_per_m=1000"),
    "output.depth_range": ("mesh", "output.depth_range=scene"),
    "output.depth_beyond": ("mesh", "output.depth_beyond=farthest"),
    "output.modalities[]": ("mesh", "output.modalities=[rgb]"),
    "output.formats.normal": ("surfaces", "output.formats.normal=exr"),
    "output.formats.instance": ("surfaces", "output.formats.instance=npy"),
    "output.formats.semantic": ("surfaces", "output.formats.semantic=npy"),
    "output.formats.flow": ("surfaces", "output.formats.flow=npy"),
    "output.overview": ("mesh", "output.overview=true"),
    "output.licence": ("mesh", "output.licence=cc-by-4.0"),
    "data": ("mesh", "data=."),
    "only.scenes[]": ("mesh", "only.scenes=[box]"),
    "only.settings[]": ("mesh", "only.settings=[clean]"),
}


def film(path, first):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for n in range(3):
        writer.write(np.full((48, 64, 3), first + 20 * n, np.uint8))
    writer.release()


def truth(bag):
    for n in range(3):
        bag.add(START_NS, "/truth", bag.ros.pose_stamped(START_NS + n * STEP_NS, body(n)))


def depth_folder(path, steps):
    path.mkdir()
    for n in range(3):
        cv2.imwrite(str(path / f"{n:04d}.png"), np.full((48, 64), steps + n, np.uint16))


@pytest.fixture(scope="module")
def presets(tmp_path_factory):
    """A folder with a preset for each kind of scene and setting, and with what the changed keys name."""
    folder = tmp_path_factory.mktemp("presets")
    document = read_preset(write_world(folder)).document
    shutil.copy(folder / "mesh.ply", folder / "other.ply")
    with (folder / "other.ply").open("a") as file:
        file.write("\n")
    write_replica(folder / "other.txt", path_poses(6)[::-1])
    stamped = [f"{100 + k / 20} {k / 10} 0 1 0 0 0 1" for k in range(6)]
    (folder / "stamped.txt").write_text("\n".join(stamped) + "\n")
    (folder / "quad.obj").write_text("v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 1\nf 1 2 3 4\n")
    for name in ("room0", "room1"):
        (folder / name).mkdir()
        shutil.copy(folder / "mesh.ply", folder / f"{name}_mesh.ply")
        shutil.copy(folder / "traj.txt", folder / name / "traj.txt")
    for name, layout in (
        ("tum", "tum"),
        ("other", "tum"),
        ("lens", "nerfstudio"),
        ("lost", "scannet"),
        ("unstamped", "replica"),
        ("inertial", "euroc"),
    ):
        (folder / name).mkdir()
        getattr(recorded_layouts, layout)(folder / name)
    picture = sorted((folder / "other/rgb").iterdir())[0]
    cv2.imwrite(str(picture), 255 - cv2.imread(str(picture)))
    for name, listed in (("fewer", "rgb"), ("fewer_depth", "depth")):
        rows = (folder / f"tum/{listed}.txt").read_text().splitlines()
        (folder / f"tum/{name}.txt").write_text("\n".join(rows[:-1]) + "\n")
    (folder / "tum/k.txt").write_text("50 50 31 23\n")
    poses = (folder / "unstamped/traj.txt").read_text().splitlines()
    (folder / "unstamped/other.txt").write_text("\n".join(poses[::-1]) + "\n")
    (folder / "unstamped/stamped.txt").write_text("".join(f"{k} {k / 10} 0 1 0 0 0 1\n" for k in range(4)))
    (folder / "unstamped/times.txt").write_text("0\n1\n2\n3\n")
    (folder / "unstamped/later.txt").write_text("1\n2\n3\n4\n")
    (folder / "inertial/mav0/imu0").mkdir()
    samples = "".join(f"{recorded_layouts.START_NS + 5_000_000 * k},0,0,0,0,0,9.8\n" for k in range(20))
    (folder / "inertial/mav0/imu0/data.csv").write_text(samples)
    for name, rows in (("walk", 2), ("other", 3)):
        walk(folder, "ros1", frames=rows, change=truth).rename(folder / f"{name}.bag")
    film(folder / "walk.avi", 40)
    film(folder / "other.avi", 60)
    depth_folder(folder / "depth", 1000)
    depth_folder(folder / "depth2", 2000)
    included = {"scenes": document["scenes"], "settings": [NOISY]}
    (folder / "noisy.yaml").write_text(json.dumps(included))
    (folder / "more.yaml").write_text(json.dumps({**included, "settings": [{**NOISY, "name": "more"}]}))

    bare = {"seed": 3, "render": {"backend": "reference"}, "settings": [{"name": "clean"}], "output": {"layout": "tum"}}
    box = {"name": "box", "mesh": "mesh.ply"}
    numbered = {"name": "box", "mesh": "numbered.ply", "trajectory": "traj.txt"}
    text = (folder / "mesh.ply").read_text().replace("end_header", "property int object_id\nend_header")
    (folder / "numbered.ply").write_text(re.sub(r"(?m)^(4 .*)$", r"\1 1", text))
    wall = {"id": 1, "class_id": 93, "class_name": "wall"}
    (folder / "info_semantic.json").write_text(json.dumps({"objects": [wall]}))
    made = {
        "mesh": document,
        "stamped": {**document, "scenes": [{**box, "trajectory": {"file": "stamped.txt", "stamp_unit": "s"}}]},
        "textured": {**document, "scenes": [{**box, "mesh": "quad.obj", "up": "y", "trajectory": "traj.txt"}]},
        "handheld": {**document, "scenes": [{**box, "trajectory": {"handheld": {"frames": 3}}}]},
        "carried": {**document, "scenes": [{**box, "trajectory": {"handheld": {"frames": 3}, "body": "walker"}}]},
        "long": {**document, "scenes": [{**box, "trajectory": {"handheld": LONG}}]},
        "replica": {**document, "scenes": [{"replica": "room0"}]},
        "noisy": {**document, "settings": [NOISY]},
        "included": {**document, "settings": [{"include": "noisy.yaml"}]},
        "noises": {**document, "settings": [{"sweep": NOISES}]},
        "swept": {**document, "settings": [{"sweep": SWEPT}]},
        "rig": {**document, "rig": RIG},
        "seeing": {**document, "rig": {"depth": {**SEEN, "fx": 30, "fy": 30, "cx": 19.5, "cy": 14.5}}},
        "wide": {**document, "rig": {"depth": {**SEEN, "horizontal_fov_deg": 60}}},
        "felt": {**document, "rig": {"imu": {}}},
        "bent": {
            **document,
            "camera": {**document["camera"], "distortion": {"k1": 0.01}},
            "render": {"engine": "embree", "backend": "reference"},
        },
        "surfaces": {
            **document,
            "scenes": [numbered],
            "output": {"modalities": ["rgb", "normal", "instance", "semantic", "flow"]},
        },
        "grey": {**document, "output": {"layout": "euroc"}},
        "bag": {**bare, "scenes": [{"name": "box", "sequence": {"bag": "walk.bag", "poses": "/truth"}}]},
        "told": {**bare, "scenes": [{"name": "box", "sequence": TOLD}]},
        "counted": {**bare, "scenes": [{"name": "box", "sequence": COUNTED}]},
        "timed": {
            **bare,
            "scenes": [{"name": "box", "sequence": {**COUNTED, "poses": "stamped.txt", "stamps": "times.txt"}}],
        },
        "inertial": {**bare, "scenes": [{"name": "box", "sequence": "inertial"}]},
        "recording": {**bare, "scenes": [{"name": "box", "sequence": "tum"}]},
        "lens": {**bare, "scenes": [{"name": "box", "sequence": "lens"}]},
        "rebent": {**bare, "scenes": [{"name": "box", "sequence": "tum", "distortion": {"k1": 0.01}}]},
        "lost": {**bare, "scenes": [{"name": "box", "sequence": "lost"}]},
        "unstamped": {**bare, "scenes": [{"name": "box", "sequence": "unstamped"}]},
        "plates": {
            **bare,
            "scenes": [{"name": "box", "sequence": "tum/rgb", "layout": "images"}],
            "output": {"layout": "tum", "modalities": ["rgb"]},
        },
        "video": {**bare, "scenes": [{"name": "box", "video": "walk.avi", "depth": "depth"}]},
        "blend": {**bare, "scenes": [{"name": "box", "blend": "hall.blend", "frames": "1:2"}]},
        "sunny": {
            **bare,
            "scenes": [{"name": "box", "blend": "sunny.blend", "frames": "1:2", "air": {"soften_sun": True}}],
        },
    }
    for name, content in made.items():
        (folder / f"preset_{name}.yaml").write_text(json.dumps(content))
    return folder


@pytest.fixture(scope="module")
def hall(presets):
    bpy = pytest.importorskip("bpy", reason="Blender's package is not installed")
    scene = new_scene()
    second = scene.camera.copy()
    second.location.x += 0.1
    scene.collection.objects.link(second)
    scene.copy()
    save(presets)
    bpy.data.objects["Ball"].location.z += 0.1
    save(presets, "other")
    scene.collection.objects.link(bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN")))
    save(presets, "sunny")
    return presets


def identity_of(folder, name, *overrides):
    return plain_identity(make_plan(read_preset(folder / f"preset_{name}.yaml", overrides)), {})


@pytest.fixture(scope="module")
def identities():
    return {}


OWN_SCENES = ("blend", "sunny")
"""Bases whose plans look at a file in a Blender of its own."""


def test_every_key_is_here():
    assert sorted(CHANGES) == sorted(leaves())
    assert set(leaves()) < {name for name, _ in preset_keys()}


@cases("name", [name for name, (base, *_) in CHANGES.items() if base not in OWN_SCENES])
def test_what_decides_bytes_is_in_the_identity(presets, identities, name):
    check(presets, identities, name)


@pytest.mark.long  # each plan looks at the file in a Blender of its own
@cases("name", [name for name, (base, *_) in CHANGES.items() if base in OWN_SCENES])
def test_what_decides_bytes_of_a_blend_is_in_the_identity(hall, identities, name):
    check(hall, identities, name)


@cache
def leaves():
    return dict(preset_leaves())


def check(presets, identities, name):
    base, *overrides = CHANGES[name]
    if base not in identities:
        identities[base] = identity_of(presets, base)
    decides = leaves()[name].identity != "nothing"
    try:
        changed, said = identity_of(presets, base, *overrides), ""
    except InputError as error:  # the value cannot be had in this preset, and a line names it
        changed, said = None, str(error)
    if changed is None:
        assert decides
        assert name.rpartition(".")[2].removesuffix("[]") in said or "traj.txt" in said, name
    else:
        assert (for_machines(changed) != for_machines(identities[base])) == decides


def for_machines(identity):
    """An identity without what stands in it for people."""
    scenes = {
        name: {part: value for part, value in scene.items() if part != "entry"}
        for name, scene in identity["scenes"].items()
    }
    return {**identity, "preset": None, "preset_sha256": None, "scenes": scenes}
