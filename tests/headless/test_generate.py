# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, as a user types it."""

import fcntl
import json
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from analytic import box_depth
from worlds import (
    GENERATE,
    HIGH,
    LOW,
    ROOT,
    content,
    generate,
    generate_here,
    path_poses,
    start_generate,
    write_world,
)

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.progress import read_message

pytest.importorskip("bpy", reason="bpy is not installed")


def read_steps(path):
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    return write_world(tmp_path_factory.mktemp("world"), frames=8, size=(160, 120))


@pytest.fixture(scope="module")
def whole(world, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "out"
    generate_here(world, "--out", out)
    return out


def test_frames_show_the_room(whole):
    camera = Intrinsics(160, 120, 80.0, 80.0, 79.5, 59.5)
    poses = path_poses(8)
    for k in range(8):
        steps = read_steps(whole / f"clean/box/results/depth{k:06d}.png")
        assert (steps.dtype, steps.shape) == (np.uint16, (120, 160))
        expected, sure = box_depth(camera, poses[k], LOW, HIGH)
        assert np.abs(steps - expected * 6553.5)[sure].max() <= 0.5 + 0.2  # half a step, and float32's share of one
        colours = cv2.imread(str(whole / f"clean/box/results/frame{k:06d}.png"))[..., ::-1]
        assert {tuple(pixel) for pixel in colours[sure].tolist()} <= {
            (200, 60, 50), (60, 160, 70), (70, 90, 190), (210, 190, 80), (130, 100, 80), (230, 225, 215),
        }  # fmt: skip


def test_another_process_makes_the_same_bytes_and_says_so_on_a_pipe_in_plain_lines(world, whole, tmp_path):
    result = generate(world, "--out", tmp_path / "again")
    assert content(tmp_path / "again") == content(whole)
    assert "\r" not in result.stderr
    assert "Saved" not in result.stdout
    assert "frames/s" in result.stdout
    run = json.loads((tmp_path / "again/run.json").read_text())
    assert run["frames_rendered"] == 8
    assert run["peak_memory_bytes"] > 1e8


def test_several_processes_make_the_same_bytes(world, whole, tmp_path):
    result = generate(world, "--out", tmp_path / "jobs", "--jobs", 2)
    assert "8 frames rendered" in result.stdout
    assert content(tmp_path / "jobs") == content(whole)


def test_jpeg_is_close_and_unsubsampled(world, whole, tmp_path):
    generate_here(world, "--out", tmp_path / "jpg", "--set", "output.image=jpg", "--frames", "0:2")
    path = tmp_path / "jpg/clean/box/results/frame000001.jpg"
    lossless = cv2.imread(str(whole / "clean/box/results/frame000001.png")).astype(float)
    assert np.abs(cv2.imread(str(path)) - lossless).mean() < 0.7
    data = path.read_bytes()
    start = data.index(b"\xff\xc0")  # the frame header: sampling factors 1 x 1 of all three components
    assert [data[start + 11 + 3 * k] for k in range(3)] == [0x11] * 3


def test_one_frame_alone_equals_that_of_the_whole(world, whole, tmp_path):
    generate_here(world, "--out", tmp_path / "one", "--frames", "5:6")
    for name in ("frame000005.png", "depth000005.png"):
        alone = (tmp_path / "one/clean/box/results" / name).read_bytes()
        assert alone == (whole / "clean/box/results" / name).read_bytes()


@pytest.mark.parametrize("offset_m", [1e4, 1e5])
def test_far_away_nothing_is_lost_of_doubles(whole, tmp_path, offset_m):
    # The mesh holds float64 coordinates, so all that there is can be kept.
    preset = write_world(tmp_path / "far", frames=8, size=(160, 120), shift_m=(offset_m, -offset_m, offset_m / 2))
    result = generate_here(preset, "--out", tmp_path / "out", "--frames", "0:2")
    assert "far from the origin" in result.stderr
    for k in range(2):
        near = read_steps(whole / f"clean/box/results/depth{k:06d}.png").astype(int)
        far = read_steps(tmp_path / f"out/clean/box/results/depth{k:06d}.png").astype(int)
        assert np.abs(near - far).max() <= 1
    first = (tmp_path / "out/clean/box/traj.txt").read_text().split()
    assert float(first[3]) == pytest.approx(offset_m + 0.3, abs=1e-9)


FRAMES = 12
KILLS = 8  # each takes seconds; tests/pipeline/crash_every_step.py ends a run before each of its steps


@pytest.fixture(scope="module")
def killing_world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("killing") / "world"
    return write_world(folder, frames=FRAMES, size=(160, 120), output={"layout": "replica", "image": "jpg"})


@pytest.fixture(scope="module")
def undisturbed(killing_world, tmp_path_factory):
    """The bytes of a run that nothing ended."""
    out = tmp_path_factory.mktemp("undisturbed") / "out"
    generate_here(killing_world, "--out", out)
    return content(out)


def wait_for_images(process, out, count):
    """Wait until a process has written so many images, or has ended."""
    while process.poll() is None and len(images_in(out)) < count:
        time.sleep(0.02)


def images_in(out):
    """The images of a dataset, in their places or in shards."""
    try:
        return list(out.glob("**/clean/box/results/*"))
    except FileNotFoundError:  # a shard's folder was removed just now
        return images_in(out)


def test_killed_at_random_moments_and_resumed(killing_world, undisturbed, tmp_path):
    chance = random.Random(4)
    kills = runs = 0
    while kills < KILLS:
        runs += 1
        assert runs <= KILLS, "runs end before they can be killed"
        jobs, out = 1 + runs % 2, tmp_path / f"killed-{runs}"
        for images in sorted(chance.sample(range(FRAMES), 3)):
            process = start_generate(killing_world, "--out", out, "--jobs", jobs)
            wait_for_images(process, out, images)
            time.sleep(chance.uniform(0, 0.03))
            os.killpg(process.pid, signal.SIGKILL)
            kills += process.wait(60) == -signal.SIGKILL
            process.communicate(timeout=60)
            for path in images_in(out):
                assert cv2.imread(str(path), cv2.IMREAD_UNCHANGED) is not None, f"{path} is half-written"
        generate_here(killing_world, "--out", out)
        assert content(out) == undisturbed
    left = left_in_memory()
    time.sleep(0.5 if left else 0)
    assert not left & left_in_memory(), "a killed run's scratch file stays"


def left_in_memory():
    """The scratch folders that no process holds; what another test makes or removes just now is gone or held soon."""
    return {path for path in Path("/dev/shm").glob("noisy-world-*") if not is_held(path)}


def is_held(folder):
    """Tell whether a living process holds the lock of a folder or has just removed it, or another user has it."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except (FileNotFoundError, PermissionError):
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


# A terminal tells the whole group, a batch system the first process alone.
@pytest.mark.parametrize(
    ("number", "jobs"),
    [(signal.SIGINT, 2), (signal.SIGTERM, 1), pytest.param(signal.SIGTERM, 2, marks=pytest.mark.long)],
)
def test_interrupted_says_how_to_resume(killing_world, undisturbed, tmp_path, jobs, number):
    out = tmp_path / "out"
    process = start_generate(killing_world, "--out", out, "--jobs", jobs)
    wait_for_images(process, out, 3)
    if number == signal.SIGINT:
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    command = shlex.split(errors.strip().splitlines()[-1])
    assert 0 < len([path for path in images_in(out) if path.name.startswith("depth")]) <= FRAMES
    assert (out / ".noisy_world/unfinished").is_dir()
    assert not list(out.glob("**/unfinished/*"))
    assert command[:2] == [sys.executable, str(GENERATE)]
    again = generate_here(*command[2:])
    assert " kept" in again.stdout
    assert content(out) == undisturbed


@pytest.mark.skipif(os.geteuid() != 0 or not shutil.which("mount"), reason="mounting a small disk needs root")
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_full_disk_is_one_line(killing_world, undisturbed, tmp_path, jobs):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=128k", "none", disk], check=False).returncode != 0:
        pytest.skip("this machine mounts nothing")
    try:
        make = generate_here if jobs == 1 else generate
        result = make(killing_world, "--out", disk / "out", "--jobs", jobs, check=False)
        assert result.returncode == 1
        lines = [line for line in result.stderr.splitlines() if line.startswith("generate.py: ")]
        assert len(lines) == 1
        assert "no space left" in lines[0]
        assert "Traceback" not in result.stderr
        images = images_in(disk / "out")
        assert 0 < len(images) < 2 * FRAMES
        assert all(cv2.imread(str(path), cv2.IMREAD_UNCHANGED) is not None for path in images)
        assert not list(disk.glob("out/**/unfinished/*"))
        subprocess.run(["mount", "-o", "remount,size=64m", disk], check=True)
        again = generate_here(killing_world, "--out", disk / "out")
        assert " kept" in again.stdout
        assert content(disk / "out") == undisturbed
    finally:
        subprocess.run(["umount", "-l", disk], check=True)


def test_dry_run_and_lists_write_nothing(world, tmp_path):
    out = tmp_path / "nothing"
    plan = generate_here(world, "--out", out, "--dry-run", "--frames", "2:5").stdout
    assert all(words in plan for words in ("sequences  1", "renders    1, 3 frames", "160 x 120", "estimate   "))
    assert generate_here(world, "--list").stdout == "clean/box\n"
    assert generate_here("--set", "settings.0.name=other", world, "--list").stdout == "other/box\n"
    assert generate_here(world, "--list", "settings").stdout == "clean\n"
    assert "8 frames" in generate_here(world, "--list", "scenes").stdout
    assert "render.samples" in generate_here("--list", "keys").stdout
    assert "presets/demo.yaml" in generate_here("--list", "presets").stdout
    listed = generate_here("--list", "layouts").stdout
    assert any(line.split()[:3] == ["euroc", "EuRoC", "ASL,"] for line in listed.splitlines())
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "render.sampels=2"], ["preset.yaml", "render.sampels", "'samples'"]),
        (["--set", "render.samples=many"], ["render.samples", "the text 'many'", "whole number"]),
        (["--set", "render.samples=0"], ["render.samples", "out of range", "1 to 65536"]),
        (["--set", "scenes.0.mesh=none.ply"], ["scenes.0.mesh", "no such file", "relative to the preset"]),
        (["--set", "scenes.3.mesh=none.ply"], ["scenes.3", "no entry"]),
        (["--frames", "90:95"], ["--frames 90:95", "8 frames", "0:8"]),
        (["--set", "output.layout=tum", "output.image=jpg"], ["output.image", "png"]),
    ],
)
def test_mistakes_are_one_line(world, tmp_path, arguments, words):
    result = generate_here(world, "--out", tmp_path / "out", *arguments, check=False)
    assert result.returncode == 1
    assert len(result.stderr.strip().splitlines()) == 1
    for word in words:
        assert word in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("arguments", [["--frames", "5"], ["--frames", "a:b"], ["--jobs", "0"], ["--lst"]])
def test_misspelt_options_are_usage_errors(world, arguments):
    result = generate_here(world, *arguments, check=False)
    assert result.returncode == 2
    assert "Traceback" not in result.stderr


def test_a_rig_with_two_sensors(tmp_path):
    # The depth sensor sits 10 cm to the right of the colour sensor, which sits at the robot's centre, turned by 90 deg.
    rig = {
        "rgb": {"rotation_euler_deg": [0, 0, 0]},
        "depth": {"translation_m": [0.1, 0, 0], "quat_wxyz": [1, 0, 0, 0]},
    }
    preset = write_world(tmp_path / "world", frames=2, size=(160, 120), rig=rig)
    out = tmp_path / "out"
    generate_here(preset, "--out", out)
    generate_here(preset, "--out", tmp_path / "plain", "--set", "rig=null")
    folder = out / "clean/box"
    poses = {
        name: np.loadtxt(folder / name).reshape(-1, 4, 4) for name in ("traj.txt", "traj_depth.txt", "traj_robot.txt")
    }
    assert np.array_equal(poses["traj.txt"], poses["traj_robot.txt"])
    offset = poses["traj_depth.txt"][:, :3, 3] - poses["traj.txt"][:, :3, 3]
    assert np.allclose(offset, 0.1 * poses["traj.txt"][:, :3, 0], atol=1e-12)
    camera = Intrinsics(160, 120, 80.0, 80.0, 79.5, 59.5)
    for k in range(2):
        expected, sure = box_depth(camera, poses["traj_depth.txt"][k], LOW, HIGH)
        steps = read_steps(folder / f"results/depth{k:06d}.png")
        assert np.abs(steps - expected * 6553.5)[sure].max() <= 0.7
        name = f"clean/box/results/frame{k:06d}.png"
        assert (out / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()


@pytest.mark.parametrize(
    ("script", "words", "told"),
    [
        ("generate.py", ["preset.yaml"], ["opencv-contrib-python-headless", "make -C"]),
        ("export_mesh.py", ["embedded:room", "room.ply"], ["numpy, opencv-contrib-python-headless: missing in this"]),
    ],
)
def test_a_missing_package_is_named_with_the_command(script, words, told):
    # A Python that has nothing but its standard library, as `-S` leaves out what is installed.
    command = [sys.executable, "-I", "-S", ROOT / "headless" / script, *words]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"{script}: ")
    assert all(word in line for word in told)


def test_workbench_makes_the_same_room(world, whole, tmp_path):
    settings = ["render.engine=workbench", "output.overview=true"]
    result = generate(world, "--out", tmp_path / "out", "--set", *settings, check=False)
    if "need OpenGL" in result.stderr:
        pytest.skip("no software GL here")
    assert result.returncode == 0, result.stderr
    assert "EGL" not in result.stderr
    for k in range(8):
        mine, other = (read_steps(out / f"clean/box/results/depth{k:06d}.png") for out in (tmp_path / "out", whole))
        assert np.mean(np.abs(mine.astype(int) - other) > 3) < 0.01
        mine, other = (
            cv2.imread(str(out / f"clean/box/results/frame{k:06d}.png")) for out in (tmp_path / "out", whole)
        )
        assert np.mean(np.abs(mine.astype(int) - other) > 1) < 0.02
    assert "gl" in json.loads((tmp_path / "out/manifest.json").read_text())["identity"]["versions"]


def test_a_depth_only_preset_writes_the_same_depth(world, whole, tmp_path):
    generate_here(world, "--out", tmp_path / "out", "--set", "output.modalities=[depth]")
    for k in range(8):
        name = f"clean/box/results/depth{k:06d}.png"
        assert (tmp_path / "out" / name).read_bytes() == (whole / name).read_bytes()
    assert not list((tmp_path / "out").rglob("frame0*"))


def test_progress_for_programs(world, tmp_path):
    result = generate_here(world, "--out", tmp_path / "out", "--frames", "0:3", "--progress", "json")
    told = [message for line in result.stdout.splitlines() if (message := read_message(line))]
    assert told[0] == {"start": {"label": "rendering", "total": 3, "done": 0}}
    assert sum(message.get("advance", 0) for message in told) == 3
    assert {"finish": True} in told
    assert told[-1]["result"].startswith("3 frames rendered")
    assert f"wrote {tmp_path / 'out/clean/box'}" in result.stdout
    assert result.stderr == ""


def test_errors_for_programs_are_the_same_sentence(world, tmp_path):
    wrong = (world, "--out", tmp_path / "out", "--set", "render.sampels=1", "--progress", "json")
    result = generate_here(*wrong, check=False)
    assert result.returncode == 1
    (told,) = [message for line in result.stdout.splitlines() if (message := read_message(line))]
    assert result.stderr == f"generate.py: {told['error']}\n"
    assert "did you mean 'samples'" in told["error"]


def test_a_run_whose_listener_is_gone_stops(killing_world, tmp_path):
    out = tmp_path / "out"
    process = start_generate(killing_world, "--out", out, "--progress", "json")
    while "start" not in (read_message(process.stdout.readline()) or {}):
        assert process.poll() is None
    process.stdout.close()
    assert process.wait(timeout=120) == 130
    assert 0 < len(list(out.glob("clean/box/results/depth*"))) < FRAMES
    process.stderr.close()
