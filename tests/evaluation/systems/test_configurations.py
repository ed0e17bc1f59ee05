# SPDX-License-Identifier: GPL-3.0-or-later
"""What neural systems are configured with, read as their loaders do, and a stand-in for one that is run like one."""

import json
import os
import runpy
import subprocess
import sys

import cv2
import foreign_loaders
import numpy as np
import pytest
import yaml
from refusals import refused

from noisy_world.evaluate.configurations import CONFIGURATIONS, bound_m, main, working_size
from noisy_world.evaluate.estimates import read_estimate
from noisy_world.evaluate.system_runs import PROGRAMS

WIDE, HIGH, COUNT = 24, 18, 5
STEPS = 2500  # 2 m


@pytest.fixture
def index(tmp_path):
    """Frames of WIDE x HIGH pixels; frame k has colour 10 k, and depth of 2 m."""
    frames = []
    for k in range(COUNT):
        colour, depth = tmp_path / f"data/{k}.png", tmp_path / f"data/depth{k}.png"
        colour.parent.mkdir(exist_ok=True)
        assert cv2.imwrite(str(colour), np.full((HIGH, WIDE, 3), 10 * k, np.uint8))
        assert cv2.imwrite(str(depth), np.full((HIGH, WIDE), STEPS, np.uint16))
        frames.append(
            {"index": k, "stamp_s": 0.05 * k, "colour": str(colour), "depth": str(depth), "depth_stamp_s": 0.05 * k}
        )
    camera = {"width": WIDE, "height": HIGH, "fx": 20.5, "fy": 21.0, "cx": 11.5, "cy": 8.5}
    return {"camera": camera, "depth_scale_per_m": 1250.0, "frames": frames}


def loaded(path, checkout):
    """As load_config of these systems does: what it inherits, by a path in the checkout, and its own keys over that."""

    def merge(one, other):
        for name, value in other.items():
            one[name] = merge(one.get(name, {}), value) if isinstance(value, dict) else value
        return one

    told = yaml.full_load(path.read_text())
    return merge(yaml.full_load((checkout / told["inherit_from"]).read_text()), told)


@pytest.fixture
def checkout(tmp_path):
    for name in ("replica.yaml", "replica_imap.yaml", "replica_mono.yaml"):
        path = tmp_path / "checkout/configs/Replica" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(
            "dataset: replica\ntracking: {ignore_edge_W: 100, ignore_edge_H: 100, lr: 0.001, buffer: 250}\n"
            "mapping: {ckpt_freq: 500}\ncam: {H: 680, W: 1200, fx: 600.0, fy: 600.0, cx: 599.5, cy: 339.5, far: 5}\n"
        )
    return tmp_path / "checkout"


def write(name, index, folder):
    (folder / "run").mkdir()
    return CONFIGURATIONS[name].write(index, folder / "run")


def is_camera(cam):
    wanted = {"H": HIGH, "W": WIDE, "fx": 20.5, "fy": 21.0, "cx": 11.5, "cy": 8.5, "png_depth_scale": 1250.0}
    return {name: cam[name] for name in wanted} == wanted


def check_sequence(folder, *, colour_only=False):
    found = foreign_loaders.slam_replica(folder)
    assert len(found.rgb) == len(found.depth) == len(found.c2w) == COUNT
    assert [int(cv2.imread(str(path))[0, 0, 0]) for path in found.rgb] == [0, 10, 20, 30, 40]
    depth = {int(cv2.imread(str(path), cv2.IMREAD_UNCHANGED).max()) for path in found.depth}
    assert depth == ({1250} if colour_only else {STEPS})
    assert np.array_equal(found.c2w[0], np.eye(4))
    moved = found.c2w[:, :3, 3] - found.c2w[:, :3, 3].mean(axis=0)
    assert np.linalg.matrix_rank(moved) == 3  # evo aligns no path of less


@pytest.mark.parametrize(("name", "inherited"), [("nice_slam", "replica.yaml"), ("imap", "replica_imap.yaml")])
def test_nice_slam_and_imap(tmp_path, index, checkout, name, inherited):
    started = write(name, index, tmp_path)
    program = [str(PROGRAMS / "checkpoint_poses.py"), name, str(tmp_path / "run/result/ckpts")]
    system = ["run.py", str(tmp_path / "run/configuration.yaml"), *(["--imap"] if name == "imap" else [])]
    assert started == [*program, str(tmp_path / "run"), *system]
    assert yaml.full_load((tmp_path / "run/configuration.yaml").read_text())["inherit_from"].endswith(inherited)
    told = loaded(tmp_path / "run/configuration.yaml", checkout)
    assert is_camera(told["cam"])
    assert told["cam"]["crop_edge"] == 0
    assert told.get("scale") == (0.1 if name == "imap" else None)  # iMAP's own, which its poses are divided by
    assert (told["tracking"]["ignore_edge_W"], told["tracking"]["ignore_edge_H"]) == (2, 3)  # 100 of 1200, of 680
    assert told["tracking"]["lr"] == 0.001
    assert told["mapping"]["bound"] == told["mapping"]["marching_cubes_bound"]
    assert told["data"]["output"] == str(tmp_path / "run/result")
    check_sequence(tmp_path / "run/sequence")
    assert told["data"]["input_folder"] == str(tmp_path / "run/sequence")


def test_co_slam(tmp_path, index, checkout):
    program = [str(PROGRAMS / "checkpoint_poses.py"), "co_slam", str(tmp_path / "run/result"), str(tmp_path / "run")]
    system = ["coslam.py", "--config", str(tmp_path / "run/configuration.yaml")]
    assert write("co_slam", index, tmp_path) == [*program, *system]
    told = loaded(tmp_path / "run/configuration.yaml", checkout)
    assert is_camera(told["cam"])
    assert told["cam"]["far"] == told["mapping"]["bound"][0][1]
    assert (told["tracking"]["ignore_edge_W"], told["tracking"]["ignore_edge_H"]) == (1, 1)
    assert (told["data"]["output"], told["data"]["exp_name"]) == (str(tmp_path / "run"), "result")
    check_sequence(tmp_path / "run/sequence")


@pytest.mark.parametrize(("name", "mode"), [("go_slam", "rgbd"), ("go_slam_mono", "mono")])
def test_go_slam(tmp_path, index, checkout, name, mode):
    if mode == "mono":
        for frame in index["frames"]:
            frame["depth"] = None
    started = write(name, index, tmp_path)
    assert started == ["run.py", str(tmp_path / "run/configuration.yaml"), "--device", "cuda:0", "--mode", mode]
    told = loaded(tmp_path / "run/configuration.yaml", checkout)
    assert told["mode"] == mode
    assert is_camera(told["cam"])
    assert (told["cam"]["H_out"], told["cam"]["W_out"], told["tracking"]["buffer"]) == (16, 24, 64)
    check_sequence(tmp_path / "run/sequence", colour_only=mode == "mono")


@pytest.mark.parametrize(
    ("size", "wanted"),
    [((680, 1200), (344, 600)), ((480, 640), (392, 520)), ((240, 320), (240, 320)), ((4, 4), (8, 8))],
)
def test_the_size_that_go_slam_works_on(size, wanted):
    assert working_size(*size) == wanted
    assert np.prod(wanted) <= 1.02 * 320 * 640


def test_splatam(tmp_path, index, monkeypatch):
    published = tmp_path / "checkout/configs/replica/splatam_s.py"
    published.parent.mkdir(parents=True)
    published.write_text(
        'config = dict(workdir="./experiments", run_name="room0_0", use_wandb=True, tracking=dict(num_iters=10),\n'
        '              data=dict(basedir="./data/Replica", start=0, end=-1, stride=1, num_frames=-1))\n'
    )
    assert write("splatam_s", index, tmp_path) == ["scripts/splatam.py", str(tmp_path / "run/configuration.py")]
    monkeypatch.chdir(tmp_path / "checkout")
    config = runpy.run_path(str(tmp_path / "run/configuration.py"))["config"]
    assert config["tracking"] == {"num_iters": 10}
    assert (config["workdir"], config["run_name"], config["use_wandb"]) == (str(tmp_path / "run"), "result", False)
    data = config["data"]
    assert (data["start"], data["stride"], data["num_frames"]) == (0, 1, COUNT)
    assert (data["desired_image_height"], data["densification_image_width"]) == (HIGH, WIDE // 2)
    dataset = yaml.full_load(open(data["gradslam_data_cfg"]))  # noqa: PTH123, SIM115
    assert dataset["dataset_name"] == "replica"
    camera = dataset["camera_params"]
    assert (camera["image_height"], camera["image_width"], camera["fx"], camera["cy"]) == (HIGH, WIDE, 20.5, 8.5)
    assert camera["png_depth_scale"] == 1250.0
    found = foreign_loaders.splatam_replica(tmp_path / "run/sequence")
    assert os.path.join(data["basedir"], data["sequence"]) == str(tmp_path / "run/sequence")  # noqa: PTH118
    assert len(found.rgb) == COUNT


def test_splatam_reads_no_grey_images(tmp_path, index):
    assert cv2.imwrite(index["frames"][0]["colour"], np.zeros((HIGH, WIDE), np.uint8))
    refused(write, "splatam_s", index, tmp_path, names=["0.png: ", "output.colour"])


def test_bounds_are_as_far_as_the_camera_sees(index):
    x, y = np.meshgrid((np.arange(WIDE) - 11.5) / 20.5, (np.arange(HIGH) - 8.5) / 21.0)
    farthest = 1.1 * np.percentile(2.0 * np.hypot(np.hypot(x, y), 1.0), 99)
    low, high = bound_m(index)[0]
    assert low == -high
    assert farthest <= high < farthest + 0.01
    depth = np.zeros((HIGH, WIDE), np.uint16)
    depth[3:9, 4:20] = 5000  # one frame that sees farther decides
    assert cv2.imwrite(index["frames"][3]["depth"], depth)
    assert bound_m(index)[2][1] > 1.9 * high * 0.9
    for frame in index["frames"]:
        assert cv2.imwrite(frame["depth"], np.zeros((HIGH, WIDE), np.uint16))
    refused(bound_m, index, names="no depth")
    assert cv2.imwrite(index["frames"][0]["depth"], np.zeros((HIGH, WIDE), np.uint8))
    refused(bound_m, index, names=[index["frames"][0]["depth"], "16 bits"])


# --- started as a user starts it ---

# Stands for NICE-SLAM: reads what its configuration names, and saves poses.
RUN_PY = """
import pickle, sys
from pathlib import Path
import numpy as np, yaml
told = yaml.full_load(open(sys.argv[1]))
yaml.full_load(open(told["inherit_from"]))
rows = np.loadtxt(Path(told["data"]["input_folder"]) / "traj.txt").reshape(-1, 4, 4)
rows[:, :3, 3] = np.arange(len(rows))[:, None] * [0.5, 0.25, 0.125]
rows[:, :3, 1:3] *= -1
out = Path(told["data"]["output"]) / "ckpts"
out.mkdir(parents=True)
for last in (2, len(rows) - 1):
    (out / f"{last:05d}.tar").write_bytes(pickle.dumps({"estimate_c2w_list": rows, "idx": last}))
"""
TORCH_PY = """
import pickle
__version__ = "1.10.1"
def load(path, map_location):
    assert map_location == "cpu"
    return pickle.load(open(path, "rb"))
"""


def refused_line(capsys, *arguments):
    with pytest.raises(SystemExit) as ended:
        main([*map(str, arguments)])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_a_system_is_started_in_its_checkout(tmp_path, index, checkout, capsys, monkeypatch):
    monkeypatch.setenv("NOISY_WORLD_ENVIRONMENTS", str(tmp_path / "environments"))
    frames, out = tmp_path / "frames.json", tmp_path / "out"
    frames.write_text(json.dumps(index))
    out.mkdir()
    environment = tmp_path / "environments/.venv-nice-slam"
    assert refused_line(capsys, "nice_slam", frames, out).startswith("there is no Python of the system in")
    (environment / "bin").mkdir(parents=True)
    # Not a link: Python would not find its packages from there.
    shim = f'#!/bin/sh\n[ -z $PYTHONPATH ] || exit 9\nPYTHONPATH={checkout} exec {sys.executable} "$@"\n'
    (environment / "bin/python").write_text(shim)
    (environment / "bin/python").chmod(0o755)
    assert refused_line(capsys, "nice_slam", "--versions").startswith("there is no run.py in")
    (environment / "checkout").symlink_to(checkout)
    (checkout / "run.py").write_text(RUN_PY)
    assert refused_line(capsys, "nice_slam", "--versions").startswith("there is no pretrained/coarse.pt in")
    (checkout / "pretrained").mkdir()
    (checkout / "pretrained/coarse.pt").touch()
    assert refused_line(capsys, "nice_slam", "--versions").startswith("there is no pretrained/middle_fine.pt in")
    (checkout / "pretrained/middle_fine.pt").touch()
    assert "No module named 'torch'" in refused_line(capsys, "nice_slam", "--versions")
    (checkout / "torch.py").write_text(TORCH_PY)
    main(["nice_slam", "--versions"])
    told = json.loads(capsys.readouterr().out)
    assert (told["torch"], told["commit"]) == ("1.10.1", "unknown")
    assert "is no index of frames" in refused_line(capsys, "nice_slam", tmp_path / "none.json", out)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    command = [sys.executable, "-m", "noisy_world.evaluate.configurations", "nice_slam", frames, out]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    found = read_estimate("array", out / "poses.npz", index, axes="opengl")
    assert found.stamps_s.tolist() == [frame["stamp_s"] for frame in index["frames"]]
    wanted = np.tile(np.eye(4), (COUNT, 1, 1))
    wanted[:, :3, 3] = np.arange(COUNT)[:, None] * [0.5, 0.25, 0.125]
    assert np.array_equal(found.c2w, wanted)
