"""A system is somebody else's program: whatever it leaves, takes or destroys is its run's result, within limits."""

import io
import json
import os
import sys
import time
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from refusals import refused
from slam_systems import script_system, write_recording

from noisy_world.core.errors import MissingDependencyError
from noisy_world.evaluate import system_isolation, system_runs
from noisy_world.evaluate.estimates import read_estimate
from noisy_world.evaluate.guard import LEAST_FREE_BYTES, CommandProcesses, ResourceLimits
from noisy_world.evaluate.system_runs import LONGEST_SENTENCE, remove_tree, run_system, sentence, system_versions

GOOD = "write(''.join(line(frame, frame['index'] / 100) for frame in frames))\n"
REMOVED = "import shutil\nout = os.path.dirname(os.path.dirname(os.getcwd()))\nshutil.rmtree(out)\n"
NPY = {"writes": {"file": "p.npy", "format": "array"}}
NPZ = {"writes": {"file": "p.npz", "format": "array"}}
linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are adopted on Linux")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "room")


def ended(tmp_path, recording, script, *, maps=False, **keys):
    return run_system(script_system(tmp_path / "system", script, **keys), recording, tmp_path / "out", maps=maps)


def npy_head(shape):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return stream.getvalue()


def packed_zeros(count):
    """A .npz whose array of zeros has so many bytes, in a thousandth of them."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("poses.npy", "w") as file:
        file.write(npy_head((count // 128, 4, 4)))
        for _ in range(count // 2**20):
            file.write(bytes(2**20))
    return stream.getvalue()


LEFT = {
    "an array that declares 1.6 TB": (
        f"open('p.npy', 'wb').write({npy_head((12_500_000_000, 4, 4))!r} + bytes(99))",
        NPY,
        "unreadable",
        "p.npy: is no array of numbers as numpy writes it",
    ),
    "a packed array of 200 MB": (
        f"open('p.npz', 'wb').write({packed_zeros(200 * 2**20)!r})",
        NPZ,
        "over_limit",
        "p.npz: holds arrays of 210 MB, more than the 64 MB of limits.estimate_mb",
    ),
    "300 MB of poses": (
        "open('poses.txt', 'w').truncate(300_000_000)",
        {},
        "over_limit",
        "poses.txt: has more than the 64 MB of limits.estimate_mb",
    ),
    "a limit of one's own": (
        "write('0 0 0 0 0 0 0 1\\n' * 100)",
        {"limits": {"estimate_mb": 0.001}},
        "over_limit",
        "poses.txt: has more than the 0.001 MB of limits.estimate_mb",
    ),
    "a pipe": ("os.mkfifo('poses.txt')", {}, "unreadable", "poses.txt: it is a pipe, not a file"),
    "a device": ("os.symlink('/dev/zero', 'poses.txt')", {}, "unreadable", "poses.txt: is a link that leads out"),
    "a link out": ("os.symlink(sys.argv[1], 'poses.txt')", {}, "unreadable", "poses.txt: is a link that leads out"),
    "a link to itself": ("os.symlink('poses.txt', 'poses.txt')", {}, "unreadable", "poses.txt: "),
    "a link inside": (
        "write(''.join(map(line, frames)), 'a.txt'); os.symlink('a.txt', 'poses.txt')",
        {},
        "finished",
        "",
    ),
    "a name with a line end": (
        "write('1 x', 'a\\x1b[2J\\nb.txt')",
        {"writes": {"file": "a*.txt"}},
        "unreadable",
        "a\\x1b[2J\\nb.txt: line 1: 'x' is not a number",
    ),
    "a name that is no text": (
        "open(b'a\\xff.txt', 'w').write('1 x')",
        {"writes": {"file": "a*.txt"}},
        "unreadable",
        "a\\xff.txt: line 1",
    ),
    "a frame of 5,000 digits": (
        GOOD + "write('index,stamp_s,state\\n' + '7' * 5000 + ',0,tracked\\n', 'frames.csv')",
        {},
        "finished",
        "its frames.csv is not used: line 2 names no frame",
    ),
    "states that are a link": (
        GOOD + "os.symlink('/etc/passwd', 'frames.csv')",
        {},
        "finished",
        "its frames.csv is not used: is a link that leads out",
    ),
    "keyframes that are a pipe": (
        GOOD + "os.mkfifo('kf.txt')",
        {"writes": {"file": "poses.txt", "keyframes": "kf.txt"}},
        "finished",
        "its keyframes are not used: kf.txt: it is a pipe",
    ),
    "a map that is a pipe": (GOOD + "os.mkfifo('map.ply')", {}, "finished", "its map.ply is not used: it is a pipe"),
    "a map beyond its limit": (
        GOOD + "open('map.ply', 'w').truncate(2_000_000)",
        {"limits": {"map_mb": 1}},
        "finished",
        "its map.ply is not used: has more than the 1 MB of limits.map_mb",
    ),
    "stamps of 5,000 digits": (
        "write('ts (ns),tx,ty,tz,qx,qy,qz,qw\\n' + '7' * 5000 + ',0,0,0,0,0,0,1\\n')",
        {"writes": {"file": "poses.txt", "format": "vslamlab"}},
        "not_finite",
        "poses.txt: line 2: holds inf",
    ),
    "what it was given removed": (
        GOOD + "import shutil\nshutil.rmtree(os.path.dirname(sys.argv[1]))",
        {},
        "finished",
        "",
    ),
    "folders without permissions": (
        GOOD + "os.makedirs('a/b'); write('', 'a/b/c'); os.chmod('a', 0)",
        {},
        "finished",
        "",
    ),
    "its folder replaced by a file": (
        GOOD + REMOVED + "write('', out)",
        {},
        "no_estimate",
        "it wrote no poses.txt; it removed its log.txt",
    ),
    "its folder replaced by a link": (
        REMOVED + "os.symlink('/etc', out)",
        {},
        "no_estimate",
        "it wrote no poses.txt; it removed its log.txt",
    ),
    "results forged": (
        GOOD + "write('{}', '../../scores.json'); write('x', '../../run.json'); os.mkdir('../../estimate.txt')",
        {},
        "finished",
        "",
    ),
    "many files": (
        "for k in range(60): write('', f'f{k}')",
        {"limits": {"files": 50}},
        "over_limit",
        "wrote more files than the 50 of limits.files",
    ),
    "folders in folders without end": (
        GOOD + "for k in range(999): os.mkdir('d'); os.chdir('d')",
        {},
        "over_limit",
        "made more than 64 folders in each other",
    ),
    "folders in folders": (
        "for k in range(200): os.mkdir('d' * 99); os.chdir('d' * 99)",
        {},
        "over_limit",
        "made more than 64 folders in each other",
    ),
    "a file beyond the limit": (
        "signal.signal(signal.SIGXFSZ, signal.SIG_DFL); open('big', 'wb').write(bytes(3_000_000))",
        {"limits": {"written_gb": 0.002}},
        "over_limit",
        "wrote more than the 0.002 GB of limits.written_gb",
    ),
    "files beyond the limit": (
        "for k in range(9): open(f'f{k}', 'wb').write(b'x' * 500_000)\ntime.sleep(60)",
        {"limits": {"written_gb": 0.002}},
        "over_limit",
        "wrote more than the 0.002 GB of limits.written_gb",
    ),
    "many processes": (
        "for k in range(9): subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\ntime.sleep(60)",
        {"limits": {"processes": 8}},
        "over_limit",
        "started more processes than the 8 of limits.processes",
    ),
    "much memory": (
        "held = b'x' * 300_000_000\ntime.sleep(60)",
        {"limits": {"memory_gb": 0.2}},
        "over_limit",
        "took more memory than the 0.2 GB of limits.memory_gb",
    ),
    "its parent ended": (
        GOOD + "os.kill(os.getppid(), signal.SIGKILL)\ntime.sleep(60)",
        {},
        "crashed",
        "it ended, stopped or disturbed the process that watches over it",
    ),
    "words put into its parent's mouth": (
        GOOD + "open(f'/proc/{os.getppid()}/fd/1', 'w').write('{}[')",
        {},
        "crashed",
        "it ended, stopped or disturbed the process that watches over it",
    ),
}


@linux
@pytest.mark.parametrize("name", LEFT)
def test_whatever_a_system_leaves_is_a_result(tmp_path, recording, name):
    script, keys, outcome, detail = LEFT[name]
    system = script_system(tmp_path / "system", script, map_arguments=["--map"], **keys)
    before = {path: path.read_bytes() for path in sorted(recording.rglob("*")) if path.is_file()}
    begun_s = time.monotonic()
    record = run_system(system, recording, tmp_path / "out", maps=True)
    assert time.monotonic() - begun_s < 30
    assert record.outcome == outcome, record
    assert record.detail.startswith(detail)
    assert bool(record.detail) == bool(detail)
    assert "\n" not in record.detail
    assert json.loads((tmp_path / "out" / "run.json").read_text())["outcome"] == outcome
    left = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"run.json", "log.txt"} <= left <= {"run.json", "log.txt", "estimate.txt"}
    assert ("estimate.txt" in left) == (outcome == "finished")
    assert {path: path.read_bytes() for path in sorted(recording.rglob("*")) if path.is_file()} == before


@linux
def test_a_guard_that_is_stopped_is_not_waited_for(tmp_path, recording, monkeypatch):
    monkeypatch.setattr("noisy_world.evaluate.system_isolation.OVERDUE_S", 0.2)
    monkeypatch.setattr("noisy_world.evaluate.system_runs.GRACE_S", 0.1)
    script = GOOD + "print(os.getpid()); write(str(os.getpid()), os.environ['PID'])\n"
    script += "os.kill(os.getppid(), signal.SIGSTOP)\ntime.sleep(60)"
    record = ended(
        tmp_path,
        recording,
        script,
        time_limit={"start_s": 0.5, "frame_s": 0.0},
        variables=[f"PID={tmp_path / 'pid'}"],
    )
    assert (record.outcome, record.detail.split(",")[0]) == ("crashed", "it ended")
    assert not is_running(int((tmp_path / "pid").read_text()))


def is_running(pid):
    """Tell whether a process is there; one that has ended and was not reaped yet is not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@linux
@pytest.mark.parametrize("cgroup", [True, False])
def test_processes_that_left_the_session_are_ended(tmp_path, recording, cgroup, monkeypatch):
    variables = [] if cgroup else ["NOISY_WORLD_TEST=1"]
    if not cgroup:  # a guard that may make no cgroup
        source = system_isolation.GUARD.read_text()
        (tmp_path / "guard.py").write_text(
            source.replace('folder = f"{own_cgroup()}', 'folder = f"/nowhere{own_cgroup()}')
        )
        monkeypatch.setattr("noisy_world.evaluate.system_isolation.GUARD", tmp_path / "guard.py")
    script = GOOD + (
        "if os.fork() == 0:\n"
        "    os.setsid()\n"
        "    if os.fork() == 0:\n"
        "        signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "        write(str(os.getpid()), 'pid.tmp'); os.rename('pid.tmp', os.environ['PID'])\n"
        "        time.sleep(60)\n"
        "    os._exit(0)\n"
        "while not os.path.exists(os.environ['PID']): time.sleep(0.01)\n"
    )
    record = ended(tmp_path, recording, script, variables=[f"PID={tmp_path / 'pid'}", *variables])
    assert record.outcome == "finished"
    assert not is_running(int((tmp_path / "pid").read_text()))


@linux
def test_a_full_disk_ends_the_run_that_fills_it(tmp_path, monkeypatch):
    free = [LEAST_FREE_BYTES * 4]
    monkeypatch.setattr(ResourceLimits, "_free_bytes", lambda self: free[0])
    limits = ResourceLimits({"written_bytes": 1, "files": 9, "processes": 9, "memory_bytes": None}, [str(tmp_path)])
    assert limits.problem(CommandProcesses.__new__(CommandProcesses)) == ""
    free[0] = LEAST_FREE_BYTES - 1
    assert limits.problem(CommandProcesses.__new__(CommandProcesses)) == "left less than 537 MB of the disk free"
    free[0] = 1000  # nearly full from the start
    assert ResourceLimits({}, [str(tmp_path)])._least_free == 500


@linux
def test_images_that_a_system_changes_are_its_own(tmp_path, recording):
    image = recording / "rgb/000000.png"
    before = image.read_bytes()
    script = GOOD + "open(frames[0]['colour'], 'wb').write(b'spoilt'); os.chmod(frames[1]['colour'], 0)"
    assert ended(tmp_path, recording, script).outcome == "finished"
    script = GOOD + "open(sys.argv[2] + '/rgb/' + sorted(os.listdir(sys.argv[2] + '/rgb'))[0], 'wb').write(b'spoilt')"
    command = [sys.executable, "-I", "-S", "-u", "{here}/program.py", "{frames}", "{sequence}"]
    assert ended(tmp_path, recording, script, command=command, reads={"layouts": ["tum"]}).outcome == "finished"
    assert image.read_bytes() == before
    assert cv2.imread(str(image)) is not None


@linux
def test_a_command_for_versions_that_never_ends(tmp_path, monkeypatch):
    monkeypatch.setattr(system_runs, "VERSIONS_LIMIT_S", 0.5)
    hold = "import os, sys, time\nif os.fork() == 0:\n    os.setsid(); time.sleep(60)\n"
    for script, told in (
        (hold + "time.sleep(60)", "0.5 s"),
        ("while True: print('y' * 9999)", "0.5 s"),
        (hold + "print('[' * 100_000)", "JSON object"),
    ):
        begun_s = time.monotonic()
        system = script_system(tmp_path / told[:1], GOOD, versions=[sys.executable, "-c", script])
        refused(system_versions, system, names=told, error=MissingDependencyError)
        assert time.monotonic() - begun_s < 20


def test_archives_are_read_within_limits(tmp_path):
    path = tmp_path / "p.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("poses.npy", npy_head((10**12, 4, 4)) + bytes(10**6))
    refused(read_estimate, "array", path, {"frames": []}, names=f"{path}: ")
    np.savez(path, poses=np.zeros((9, 4, 4)), other=np.zeros(2000))
    frames = {"frames": [{"stamp_s": float(k)} for k in range(9)]}
    assert len(read_estimate("array", path, frames)) == 0
    refused(read_estimate, "array", path, frames, largest_bytes=10_000, names=[f"{path}: ", "limits.estimate_mb"])


def test_sentences_are_short_and_plain():
    assert sentence("a\nb\x1b[31m\udcff é") == "a\\nb\\x1b[31m\\xff é"
    assert len(sentence("x" * 10**6)) == LONGEST_SENTENCE + 3


def test_what_stands_in_the_place_of_a_folder_is_removed(tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "link").symlink_to("kept")
    os.mkfifo(tmp_path / "pipe")
    for name in ("link", "pipe", "nothing"):
        assert remove_tree(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
