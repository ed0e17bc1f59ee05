# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets survive: a crash at every single step, damage, full disks, two runs at once and other people's files."""

import errno
import importlib
import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import fake_session
import pytest
from refusals import refused
from cases import cases
from worlds import ROOT, content, write_world
import runs

from noisy_world.core import atomic_files
from noisy_world.core.errors import InterruptedRunError, StorageError
from noisy_world.dataset import identity
from noisy_world.dataset.plan import make_plan
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.remaking import made_here, made_otherwise
from noisy_world.dataset.run import Run


VERSIONS = {name: importlib.import_module(name).__version__ for name in ("cv2", "OpenEXR", "deflate", "numpy")}


class Listener:
    def __init__(self):
        self.notes = []

    def start(self, label, total, done=0):
        pass

    def advance(self, count=1):
        pass

    def note(self, text, subject=""):
        self.notes.append(text)

    def finish(self):
        pass


pytestmark = pytest.mark.usefixtures("no_blender")


def run(preset, out, **options):
    listener = Listener()
    return runs.run(preset, out, progress=listener, **options), listener


@pytest.fixture
def world(tmp_path):
    return write_world(tmp_path / "world", frames=4, size=(8, 6), settings=[{"name": "clean"}, {"name": "same"}])


@pytest.fixture
def whole(world, tmp_path):
    run(world, tmp_path / "whole")
    return content(tmp_path / "whole")


def test_layout_and_papers(world, whole, tmp_path):
    out = tmp_path / "whole"
    names = {f"{kind}{k:06d}.png" for k in range(4) for kind in ("frame", "depth")}
    for setting in ("clean", "same"):
        assert {path.name for path in (out / setting / "box" / "results").iterdir()} == names
        poses = (out / setting / "box" / "traj.txt").read_text().splitlines()
        assert len(poses) == 4
        assert all(len(line.split()) == 16 for line in poses)
        camera = json.loads((out / setting / "cam_params.json").read_text())["camera"]
        assert camera == {"w": 8, "h": 6, "fx": 4.0, "fy": 4.0, "cx": 3.5, "cy": 2.5, "scale": 6553.5}
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["frames"] == {"clean/box": 4, "same/box": 4}
    for folder in ("clean/box", "same/box"):
        for name, digest in manifest["files"][folder].items():
            assert whole[f"{folder}/{name}"] == digest
        for line in (out / folder / "frames.jsonl").read_text().splitlines():
            for name, digest in json.loads(line)["sha256"].items():
                assert whole[f"{folder}/{name}"] == digest
    assert {path.name for path in out.iterdir()} == {"clean", "same", "manifest.json", "run.json"}


def test_settings_with_the_same_pixels_share_files(whole, tmp_path):
    names = [tmp_path / "whole" / setting / "box/results/depth000002.png" for setting in ("clean", "same")]
    assert names[0].samefile(names[1])
    assert fake_session.Session.rendered == [0, 1, 2, 3]


def test_the_same_again_renders_nothing(world, whole, tmp_path):
    fake_session.Session.rendered.clear()
    report, _ = run(world, tmp_path / "whole")
    assert (report.frames_rendered, report.frames_kept) == (0, 4)
    assert fake_session.Session.rendered == []
    assert content(tmp_path / "whole") == whole


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_crash_at_every_step_costs_nothing(tmp_path):
    late = {"name": "late", "perturb": [{"gaussian_noise": None}, {"desync": {"offset": 1}}]}
    world = write_world(tmp_path / "crash", frames=3, size=(8, 6), settings=[{"name": "clean"}, late])
    run(world, tmp_path / "whole")
    # In a process of its own, which has no threads yet and can be forked.
    script = Path(__file__).with_name("crash_every_step.py")
    command = [sys.executable, script, world, tmp_path / "whole", tmp_path]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) > 60, "the steps were not counted"


def test_a_torn_journal_line_is_dropped(world, whole, tmp_path):
    out = tmp_path / "torn"
    stop_before(2, world, out)
    (journal,) = (out / ".noisy_world").glob("journal-0.box.jsonl")
    data = journal.read_bytes()
    assert data.count(b"\n") >= 1
    journal.write_bytes(data + data[: len(data) // 2].replace(b"\n", b""))
    run(world, out)
    assert content(out) == whole


def stop_before(frame, world, out):
    """Run until before a frame, as Ctrl-C does."""
    stop = threading.Event()
    original = fake_session.Session.frame

    def render(self, number):
        if number.index == frame - 1:
            stop.set()
        return original(self, number)

    fake_session.Session.frame = render
    try:
        with pytest.raises(InterruptedRunError):
            run(world, out, stop=stop)
    finally:
        fake_session.Session.frame = original


@pytest.mark.parametrize("damage", ["truncate", "flip", "remove", "empty"])
def test_damaged_frames_are_made_again(world, whole, tmp_path, damage):
    out = tmp_path / "whole"
    path = out / "clean/box/results/frame000001.png"
    data = path.read_bytes()
    path.unlink()  # the other setting's name for the same file stays whole
    if damage != "remove":
        path.write_bytes({"truncate": data[:-7], "flip": data[:-7] + b"x" + data[-6:], "empty": b""}[damage])
    fake_session.Session.rendered.clear()
    run(world, out)
    assert fake_session.Session.rendered == [1]
    assert content(out) == whole


def test_stopped_and_resumed(world, whole, tmp_path):
    out = tmp_path / "stopped"
    stop_before(3, world, out)
    assert len(list((out / "clean/box/results").iterdir())) == 6
    fake_session.Session.rendered.clear()
    run(world, out)
    assert fake_session.Session.rendered == [3]
    assert content(out) == whole


def test_parts_make_the_whole(world, whole, tmp_path):
    out = tmp_path / "parts"
    run(world, out, frames=slice(2, None))
    poses = (out / "clean/box/traj.txt").read_text().splitlines()
    assert len(poses) == 2
    assert {path.name for path in (out / "clean/box/results").glob("frame*")} == {"frame000002.png", "frame000003.png"}
    run(world, out, frames=slice(0, 2))
    assert content(out) == whole


def test_another_preset_is_refused_and_overwrite_replaces_only_its_own(world, whole, tmp_path):
    out = tmp_path / "whole"
    other = write_world(tmp_path / "other", frames=3, size=(8, 6))
    (out / "notes.txt").write_text("mine")
    (out / "clean/box/mine.txt").write_text("mine too")
    refused(run, other, out, names=[str(out), "--overwrite"], error=StorageError)
    assert (out / "same/box/results/frame000003.png").exists()
    run(other, out, overwrite=True)
    assert (out / "notes.txt").read_text() == "mine"
    assert (out / "clean/box/mine.txt").read_text() == "mine too"
    assert not (out / "same").exists()
    assert len(list((out / "clean/box/results").iterdir())) == 6


def test_the_refusal_names_what_differs(world, whole, tmp_path):
    plan = make_plan(read_preset(world, ["render.samples=2"]))
    again = Run(plan, tmp_path / "whole", progress=Listener(), stop=threading.Event())
    refused(again.make_dataset, names="render.samples was 1, is 2", error=StorageError)


@cases("package", ["cv2", "OpenEXR", "deflate", "numpy"])
def test_another_version_of_what_decides_the_bytes_is_refused(world, tmp_path, package):
    out = tmp_path / package
    run(world, out)
    module, name = sys.modules[package], {"cv2": "opencv", "OpenEXR": "openexr"}.get(package, package)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(module, "__version__", "1.2.3")
        refused(run, world, out, names=[f"{name} {VERSIONS[package]}", "1.2.3"], error=StorageError)


def test_a_dataset_of_the_first_release_grows_and_one_of_an_unknown_release_does_not(world, tmp_path):
    for release, grows in (("0.1.0", True), ("0.0.9", False)):
        out = tmp_path / release
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(identity, "package_version", lambda release=release: release)
            run(world, out, overrides=['settings=[{"name": "clean"}]'])
        if grows:
            run(world, out)
            assert (out / "same/box/traj.txt").is_file()
        else:
            refused(run, world, out, names=["noisy_world 0.0.9"], error=StorageError)
        here = made_here()
        there = {**here, "versions": here["versions"] | {"noisy_world": release}}
        assert ("noisy_world" in made_otherwise(there, here)) is not grows  # a recipe


def test_other_peoples_folders_are_left_alone(world, tmp_path):
    out = tmp_path / "photos"
    out.mkdir()
    (out / "cat.jpg").write_bytes(b"meow")
    for overwrite in (False, True):
        refused(run, world, out, overwrite=overwrite, names=f"{out}: ", error=StorageError)
    assert [path.name for path in out.iterdir()] == ["cat.jpg"]
    file = tmp_path / "file"
    file.write_text("x")
    refused(run, world, file, names=f"{file}: ", error=StorageError)


def test_a_run_that_fails_before_its_first_frame_leaves_nothing(world, tmp_path):
    mesh = world.parent / "mesh.ply"
    good = mesh.read_text()
    mesh.write_text(good.replace("4 20 21 22 23", "4 20 21 22 99"))
    out = tmp_path / "deep" / "out"
    refused(run, world, out, names="99")
    assert not out.exists()
    mesh.write_text(good)
    run(world, out)


def test_an_identity_without_frames_holds_nobody_up(world, whole, tmp_path):
    # Killed before its first frame was in the journal; then the preset is changed.
    out = tmp_path / "early"
    (out / ".noisy_world").mkdir(parents=True)
    (out / ".noisy_world" / "identity.json").write_text('{"format": 1, "sequences": ["clean/box", "old/box"]}')
    (out / "old/box/results").mkdir(parents=True)
    (out / "old/box/results/frame000000.png").write_bytes(b"unrecorded")
    run(world, out)
    assert content(out) == whole


def test_two_runs_at_once_are_refused(world, tmp_path):
    out = tmp_path / "busy"
    original = fake_session.Session.frame
    seen = []

    def render(self, frame):
        if frame.index == 0 and not seen:
            seen.append(True)
            refused(run, world, out, names=f"{out}: ", error=StorageError)
        return original(self, frame)

    fake_session.Session.frame = render
    try:
        run(world, out)
    finally:
        fake_session.Session.frame = original
    assert seen


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EACCES])
def test_a_disk_that_refuses(world, whole, tmp_path, monkeypatch, code):
    out = tmp_path / "full"
    original = Path.write_bytes

    def write_bytes(self, data):
        if self.name.endswith("frame000002.png"):
            original(self, data[: len(data) // 2])  # as a full disk does: some of it got there
            raise OSError(code, os.strerror(code))
        return original(self, data)

    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    refused(run, world, out, names="frame000002.png: ", error=StorageError)
    assert not list(out.rglob("*frame000002.png"))
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    run(world, out)
    assert content(out) == whole


def test_without_hard_links_files_are_copied(world, whole, tmp_path, monkeypatch):
    def hardlink_to(self, target):
        raise OSError(errno.EPERM, "no links here")

    monkeypatch.setattr(Path, "hardlink_to", hardlink_to)
    run(world, tmp_path / "copied")
    assert content(tmp_path / "copied") == whole


def test_nothing_seen_is_said_once(tmp_path):
    preset = write_world(tmp_path / "world", frames=3, size=(8, 6))
    original = fake_session.Session.frame

    def render(self, frame):
        result = original(self, frame)
        result.depth_m[:] = 0
        return result

    fake_session.Session.frame = render
    try:
        _, listener = run(preset, tmp_path / "out", overrides=["render.allow_empty=true"])
    finally:
        fake_session.Session.frame = original
    assert len([note for note in listener.notes if "sees nothing" in note and "axes" in note]) == 1


def test_the_lock_goes_with_its_process(tmp_path):
    path = tmp_path / "work" / "lock"
    code = f"""
import os, sys, time
sys.path.insert(0, {str(ROOT / "addon")!r})
from pathlib import Path
from noisy_world.core.atomic_files import FolderLock
lock = FolderLock(Path({str(path)!r}))
print("taken", flush=True)
time.sleep(60)
"""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "taken\n"
    refused(atomic_files.FolderLock, path, names=str(path.parent.parent), error=StorageError)
    process.kill()
    process.wait(60)
    atomic_files.FolderLock(path).release()


def test_a_lock_whose_file_was_replaced_is_taken_anew(tmp_path, monkeypatch):
    path, take, raced = tmp_path / "work/lock", atomic_files._try_lock, []

    def racing(descriptor):
        if not raced:  # between opening and locking, a run that ends removes the file, and another begins
            raced.append(path.unlink())
            path.touch()
        return take(descriptor)

    monkeypatch.setattr(atomic_files, "_try_lock", racing)
    lock = atomic_files.FolderLock(path)
    refused(atomic_files.FolderLock, path, names="another run", error=StorageError)
    lock.release()


def test_tum_layout(tmp_path):
    preset = write_world(tmp_path / "world", frames=3, size=(8, 6), output={"layout": "tum"})
    out = tmp_path / "out"
    run(preset, out)
    folder = out / "clean/box"
    assert sorted(path.name for path in folder.iterdir()) == [
        "associations.txt",
        "depth",
        "depth.txt",
        "frames.jsonl",
        "groundtruth.txt",
        "rgb",
        "rgb.txt",
    ]
    for line, k in zip((folder / "associations.txt").read_text().splitlines(), range(3), strict=True):
        time_a, rgb, time_b, depth = line.split()
        assert float(time_a) == float(time_b) == pytest.approx(k / 20)
        assert (folder / rgb).is_file()
        assert (folder / depth).is_file()
    poses = [line for line in (folder / "groundtruth.txt").read_text().splitlines() if not line.startswith("#")]
    assert [len(line.split()) for line in poses] == [8, 8, 8]
    assert json.loads((out / "clean/cam_params.json").read_text())["camera"]["scale"] == 5000.0


@pytest.mark.parametrize("layout", ["replica", "tum"])
@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_a_single_modality(tmp_path, layout, modality):
    output = {"layout": layout, "image": "png", "modalities": [modality], "overview": True}
    preset = write_world(tmp_path / "world", frames=3, size=(8, 6), output=output)
    out = tmp_path / "out"
    run(preset, out)
    names = {str(path.relative_to(out / "clean/box")) for path in (out / "clean/box").rglob("*") if path.is_file()}
    kind = {"rgb": "frame", "depth": "depth"}[modality]
    images = {f"results/{kind}{k:06d}.png" if layout == "replica" else f"{modality}/{k:06d}.png" for k in range(3)}
    texts = {"traj.txt"} if layout == "replica" else {"groundtruth.txt", f"{modality}.txt"}
    assert names == images | texts | {"frames.jsonl"}
    assert (out / "overview.png").stat().st_size > 500


class LateEncoders:
    """Stands in for the threads that write: what is queued is done only when it is waited for."""

    queued: list[int] = []  # how many waited when each frame came

    def __init__(self, *_, **__):
        self._waiting = 0

    def submit(self, work, *arguments):
        LateEncoders.queued.append(self._waiting)
        self._waiting += 1
        return SimpleNamespace(done=lambda: False, result=lambda: self._finish(work, arguments))

    def _finish(self, work, arguments):
        self._waiting -= 1
        work(*arguments)

    def shutdown(self, *_, **__):
        pass


def test_at_most_three_frames_wait_for_the_encoders(tmp_path, monkeypatch):
    LateEncoders.queued.clear()
    monkeypatch.setattr("noisy_world.dataset.making.ThreadPoolExecutor", LateEncoders)
    run(write_world(tmp_path / "world", frames=9, size=(8, 6)), tmp_path / "out")
    assert LateEncoders.queued == [0, 1, 2, 3, 3, 3, 3, 3, 3]
