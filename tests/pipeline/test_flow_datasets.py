# SPDX-License-Identifier: GPL-3.0-or-later
"""Flow in datasets: against the room in closed form by the written poses, whatever moves the camera, and alone."""

import io
import json
from itertools import pairwise

import numpy as np
import pytest
from refusals import refused
import yaml
from analytic import box_depth, rays
from cases import cases
from many_settings import make_shard
from worlds import HIGH, LOW, path_poses, write_replica, write_world
from runs import run

from noisy_world.core.errors import StorageError
from noisy_world.core.geometry import Intrinsics
from noisy_world.dataset.shards import Shard
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.plan import make_plan

SIZE = (63, 47)
CAMERA = Intrinsics(*SIZE, SIZE[0] / 2, SIZE[0] / 2, (SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)
V, U = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
SETTINGS = [
    {"name": "clean"},
    {"name": "fog", "perturb": [{"fog": {"severity": 3}}, {"depth_gaussian_noise": {"severity": 5}}]},
    {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 2, "edge": "drop"}}]},
    {"name": "shaken", "perturb": [{"motion_deviation": {"rotation_deg": 1.0}}]},
]
RIG = {
    "rgb": {"translation_m": [0.1, 0.05, -0.02], "rotation_euler_deg": [3, -5, 8]},
    "depth": {"translation_m": [-0.2, 0.0, 0.1]},
}
FRAMES = {"embree": 24, "cycles": 12}  # of a turn


def world(folder, engine, **output):
    return write_world(
        folder,
        frames=FRAMES[engine],
        size=SIZE,
        render={"engine": engine, "samples": 1, "backend": "reference"},
        settings=SETTINGS,
        rig=RIG,
        output={"layout": "replica", "image": "png", "modalities": ["rgb", "depth", "flow"], **output},
    )


def flows(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.glob("*/*/flow/*"))}


def exact(poses):
    """The flow (N - 1, H, W, 2) from each pose to the next by the room's first wall, and where it is in the image."""
    for here, there in pairwise(poses):
        depth_m, _ = box_depth(CAMERA, here, LOW, HIGH)
        points = here[:3, 3] + depth_m[..., None] * rays(CAMERA, here)
        x, y, z = np.moveaxis((points - there[:3, 3]) @ there[:3, :3], -1, 0)
        x, y = x / z * CAMERA.fx_px + CAMERA.cx_px, y / z * CAMERA.fy_px + CAMERA.cy_px
        inside = (z > 0) & (x >= -0.5) & (x <= SIZE[0] - 0.5) & (y >= -0.5) & (y <= SIZE[1] - 0.5)
        yield np.stack([x - U, y - V], axis=-1), inside


@cases("engine", ["embree", "cycles"])
def test_every_motion_in_closed_form(engine, tmp_path):
    pytest.importorskip("embreex" if engine == "embree" else "bpy", reason="what renders is not installed")
    preset, out = world(tmp_path / engine / "world", engine, formats={"flow": "npy"}), tmp_path / engine / "out"
    report, count = run(preset, out), FRAMES[engine]
    assert report.frames_rendered == 2 * count  # of the path as it is, and deviated
    for setting in SETTINGS:
        folder = out / setting["name"] / "box"
        numbers = [json.loads(line)["frame"] for line in (folder / "frames.jsonl").read_text().splitlines()]
        poses = np.loadtxt(folder / "traj.txt").reshape(-1, 4, 4)
        made = [np.load(folder / f"flow/{number:06d}.npy") for number in numbers]
        assert len(made) == {"fast": count // 2, "late": count - 2}.get(setting["name"], count)
        assert len(list((folder / "flow").iterdir())) == len(made)
        for flow, (expected, inside) in zip(made, exact(poses), strict=False):
            assert flow.dtype == np.float32
            ahead = np.abs(flow[..., :2] - expected)[inside]
            assert ahead.max() < 0.01
            assert np.array_equal(flow[..., 2], np.where(inside, 0, 2))
        assert sum(inside.sum() for _, inside in exact(poses)) > 1000
        assert (made[-1] == [0, 0, 3]).all()
    same = [(out / name / "box/flow/000003.npy").stat().st_ino for name in ("clean", "fog")]
    assert same[0] == same[1]  # depth is perturbed in one of them
    if engine == "embree":
        check_frames_alone(preset, tmp_path / engine, out)


def check_frames_alone(preset, folder, whole):
    """Frames that are asked for alone have the bytes of a whole run; what is lost comes back, linked as it was."""
    part = folder / "part"
    run(preset, part, frames=slice(2, 5))
    alone = flows(part)
    assert len(alone) == 3 * len(SETTINGS)
    assert alone.items() <= flows(whole).items()
    run(preset, part)
    assert flows(part) == flows(whole)

    names = {path: path.stat().st_ino for path in whole.glob("*/*/flow/*")}
    lost = whole / "clean/box/flow/000003.npy"
    lost.unlink()
    (whole / "fast/box/flow/000001.npy").write_bytes(b"no array")
    report = run(preset, whole)
    assert report.frames_rendered == 2  # the source frames 2 and 3; those after them give depth alone
    assert flows(part) == flows(whole)
    assert lost.stat().st_ino == names[whole / "fog/box/flow/000003.npy"]

    shard = folder / "shard"
    make_shard(make_plan(read_preset(preset)), shard, Shard("box", 3, 5))
    made = flows(shard)
    assert len(made) == 2 + 2 + 1 + 2
    assert made.items() <= flows(whole).items()


def test_exr_and_recordings(tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    pytest.importorskip("embreex", reason="embreex comes with an extra")
    output = {"layout": "tum", "modalities": ["rgb", "depth", "flow", "normal"], "formats": {"normal": "exr"}}
    keys = {"frames": 24, "size": SIZE, "render": {"engine": "embree", "backend": "reference"}, "output": output}
    preset = write_world(tmp_path / "world", **keys)
    run(preset, tmp_path / "out")
    sequence = tmp_path / "out/clean/box"
    with OpenEXR.File(io.BytesIO((sequence / "flow/000001.exr").read_bytes()), separate_channels=True) as file:
        rendered = np.stack([file.channels()[name].pixels for name in ("dx", "dy", "hidden")], axis=-1)
    with OpenEXR.File(io.BytesIO((sequence / "normal/000001.exr").read_bytes()), separate_channels=True) as file:
        normal = np.stack([file.channels()[name].pixels for name in "XYZ"], axis=-1)
    assert np.abs(np.linalg.norm(normal, axis=-1) - 1).max() < 1e-6
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert manifest["identity"]["output"]["formats"] == {"normal": "exr"}
    assert manifest["conventions"]["normal"].endswith("float32, not in steps")
    in_steps = write_world(tmp_path / "world", **{**keys, "output": {**output, "formats": {}}})
    refused(run, in_steps, tmp_path / "out", names="output.formats was", error=StorageError)

    recorded = tmp_path / "recorded.yaml"
    document = {
        "scenes": [{"name": "again", "sequence": str(sequence)}],
        "settings": [{"name": "clean"}, {"name": "holes", "perturb": [{"depth_random_missing": {"severity": 5}}]}],
        "output": {"layout": "tum", "modalities": ["rgb", "flow"], "formats": {"flow": "npy"}},
    }
    recorded.write_text(yaml.safe_dump(document))
    run(recorded, tmp_path / "again")
    again = np.load(tmp_path / "again/holes/again/flow/000001.npy")
    known = (again[..., 2] == 0) & (rendered[..., 2] == 0)
    assert known.mean() > 0.3
    assert np.abs(again - rendered)[known].max() < 0.01  # depth in steps of 1/5000 m

    truth = sequence / "groundtruth.txt"
    truth.write_text("\n".join(truth.read_text().splitlines()[:-3]) + "\n")
    document["scenes"][0]["poses"] = "keep"
    recorded.write_text(yaml.safe_dump(document))
    refused(make_plan, read_preset(recorded), names=["scenes.0.sequence: ", "flow", "poses: drop"])
    camera = json.loads((sequence.parent / "cam_params.json").read_text())
    camera |= {"distortion": {"model": "radial-tangential", "coefficients": [0.1, 0.0, 0.0, 0.0]}}
    (sequence.parent / "cam_params.json").write_text(json.dumps(camera))
    refused(make_plan, read_preset(recorded), names=["scenes.0.sequence: ", "flow", "undistort: true"])


def test_a_longer_path_would_change_the_last_frames_flow(tmp_path):
    pytest.importorskip("embreex", reason="embreex comes with an extra")
    output = {"layout": "replica", "modalities": ["rgb", "flow"]}
    keys = {"size": SIZE, "render": {"engine": "embree", "backend": "reference"}, "output": output}
    preset = write_world(tmp_path / "world", frames=5, **keys)
    poses = path_poses(24)
    write_replica(tmp_path / "world/traj.txt", poses[:5])
    run(preset, tmp_path / "out")
    more = {**keys, "settings": [{"name": "clean"}, SETTINGS[1]]}
    write_world(tmp_path / "world", frames=5, **more)
    write_replica(tmp_path / "world/traj.txt", poses[:5])
    run(preset, tmp_path / "out")  # by a setting it grows
    same = [tmp_path / f"out/{name}/box/flow/000002.exr" for name in ("clean", "fog")]
    assert same[0].stat().st_ino == same[1].stat().st_ino
    write_replica(tmp_path / "world/traj.txt", poses[:7])
    refused(run, preset, tmp_path / "out", names=["scenes.0", "flow"], error=StorageError)
