"""Whatever a system does is a record: systems of a few lines that do what systems do."""

import json
import os
import sys
import threading
import time

import numpy as np
import pytest
from refusals import refused
from slam_systems import script_system, write_recording

from noisy_world.core.errors import InterruptedRunError
from noisy_world.evaluate.cases import Outcome, read_estimate_file
from noisy_world.evaluate.system_runs import run_system

GOOD = "write(''.join(line(frame, frame['index'] / 100) for frame in frames))\n"
SHORT = {"time_limit": {"start_s": 1.0, "frame_s": 0.0}}


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "room")


def ended(tmp_path, recording, script, **keys):
    return run_system(script_system(tmp_path / "system", script, **keys), recording, tmp_path / "out")


def test_a_run_leaves_its_record_and_the_estimate(tmp_path, recording):
    script = GOOD + "write(line(frames[0]), 'kf.txt')\nprint('hello')\nprint('trouble', file=sys.stderr)\n"
    script += "write('index,stamp_s,state\\n0,0.0,tracked\\n', 'frames.csv')\n"
    script += "write('big', 'checkpoint.bin')\nsum(range(3_000_000))\n"
    script += "write(sys.argv[-1], 'map.ply')\n"
    writes = {"file": "poses.txt", "keyframes": "kf.txt"}
    system = script_system(tmp_path / "system", script, writes=writes, map_arguments=["--map"])
    out = tmp_path / "out"
    record = run_system(system, recording, out, maps=True)
    assert (out / "map.ply").read_text() == "--map"
    assert (record.outcome, record.detail, record.frames, record.exit_status) == (Outcome.FINISHED, "", 5, 0)
    assert 0.02 < record.processor_s <= record.seconds * 4
    assert 4e6 < record.peak_memory_bytes < 60e6  # of a bare Python, not of the process that started it
    names = {"run.json", "log.txt", "estimate.txt", "keyframes.txt", "frames.csv", "map.ply"}
    assert {path.name for path in out.iterdir()} == names
    assert json.loads((out / "run.json").read_text())["outcome"] == "finished"
    assert sorted((out / "log.txt").read_text().split()) == ["hello", "trouble"]
    estimate = read_estimate_file(out / "estimate.txt")
    assert estimate.stamps_s.tolist() == [0.0, 0.05, 0.1, 0.15, 0.2]
    assert estimate.c2w[:, 0, 3].tolist() == [0.0, 0.01, 0.02, 0.03, 0.04]
    assert len(read_estimate_file(out / "keyframes.txt")) == 1


def test_neither_the_index_nor_the_sequence_tells_a_true_pose(tmp_path, recording):
    script = "import glob\n" + GOOD
    script += "write(json.dumps([index, sorted(glob.glob(sys.argv[2] + '/**', recursive=True))]), 'given.json')\n"
    script += "write(open(sys.argv[2] + '/groundtruth.txt').read(), 'truth.txt')\n"
    system = script_system(
        tmp_path / "system",
        script,
        command=[sys.executable, "-I", "-S", "-u", "{here}/program.py", "{frames}", "{sequence}"],
        reads={"layouts": ["tum"]},
    )
    run_system(system, recording, tmp_path / "out", keep=True)
    kept = tmp_path / "out" / ".work" / "out"
    index, files = json.loads((kept / "given.json").read_text())
    assert set(index) == {"camera", "depth_scale_per_m", "inverse_depth", "frames"}
    assert index["camera"] == {"width": 8, "height": 6, "fx": 10.0, "fy": 11.0, "cx": 3.5, "cy": 2.5}
    assert index["frames"][1] == {
        "index": 1,
        "stamp_s": 0.05,
        "colour": str(tmp_path / "out/.work/given/images/rgb/000001.png"),
        "depth": str(tmp_path / "out/.work/given/images/depth/000001.png"),
        "depth_stamp_s": 0.05,
    }
    assert len(files) == 17  # five frames of two, two folders, four lists and the folder itself
    poses = [row.split()[1:] for row in (kept / "truth.txt").read_text().splitlines() if row[0] != "#"]
    assert {tuple(map(float, row)) for row in poses} == {(0, 0, 0, 0, 0, 0, 1)}


@pytest.mark.parametrize(
    ("script", "outcome", "detail"),
    [
        (GOOD + "sys.exit(3)", "crashed", "ended with status 3; log.txt holds what it said"),
        ("raise ValueError", "crashed", "ended with status 1"),
        ("os.abort()", "crashed", "was ended by SIGABRT"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "crashed", "was ended by SIGSEGV"),
        ("pass", "no_estimate", "it wrote no poses.txt"),
        ("os.mkdir('poses.txt')", "no_estimate", "it wrote no poses.txt"),
        ("write('')", "finished", ""),
        ("write('# timestamp tx ty tz qx qy qz qw\\n\\n')", "finished", ""),
        ("write(line(frames[2]))", "finished", ""),
        ("write(''.join(line(f) for f in frames))", "finished", ""),
        ("write(line(frames[0]) + line(frames[1], math.nan))", "not_finite", "poses.txt: line 2: holds nan"),
        ("write(line(frames[0]) + line(frames[1], -math.inf))", "not_finite", "poses.txt: line 2: holds -inf"),
        ("write(line(frames[0]) + '0.05 1 2\\n')", "unreadable", "poses.txt: line 2: 3 numbers"),
        ("write('segmentation fault 0\\n')", "unreadable", "poses.txt: line 1: 'segmentation' is not a number"),
        ("open('poses.txt', 'wb').write(bytes(range(256)))", "unreadable", "poses.txt: is not a text file"),
        ("write(line(frames[0]) * 2)", "finished", "1 pose has the time stamp of the pose before, which is kept"),
        ("write(line(frames[1]) + line(frames[0]))", "unreadable", "poses.txt: line 2: the time stamp"),
        ("write('77.0 0 0 0 0 0 0 1\\n')", "finished", "no pose belongs to a frame that was given, within 0.01 s"),
        ("write('timestamp tx ty tz qx qy qz qw\\n')", "finished", ""),
        (
            "write(line(frames[0]) + '77.0 0 0 0 0 0 0 1\\n')",
            "finished",
            "1 of 2 poses belong to no frame that was given",
        ),
        ("write('0.0 0 0 0 0 0 0 2\\n')", "unreadable", "poses.txt: line 1: the quaternion has length 2, not 1"),
        (GOOD + "write('a,b', 'frames.csv')", "finished", "its frames.csv is not used: its header does not begin"),
    ],
)
def test_what_systems_do(tmp_path, recording, script, outcome, detail):
    record = ended(tmp_path, recording, script)
    assert record.outcome == outcome
    assert record.detail.startswith(detail)
    assert bool(record.detail) == bool(detail)
    assert (tmp_path / "out" / "estimate.txt").exists() == (outcome == "finished")
    assert not (tmp_path / "out" / ".work").exists()


def test_a_system_that_hangs_is_stopped_with_its_children(tmp_path, recording, monkeypatch):
    monkeypatch.setattr("noisy_world.evaluate.system_runs.GRACE_S", 0.3)
    script = GOOD + "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
    script += "print(child.pid)\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\ntime.sleep(60)"
    begun = time.monotonic()
    record = ended(tmp_path, recording, script, **SHORT)
    assert (record.outcome, record.detail) == ("timed_out", "was stopped after 1 s; log.txt holds what it said")
    assert time.monotonic() - begun < 20
    assert not alive(int((tmp_path / "out" / "log.txt").read_text()))
    assert not (tmp_path / "out" / "estimate.txt").exists()


def test_children_that_stay_are_ended(tmp_path, recording):
    script = GOOD + "print(subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)']).pid)\n"
    assert ended(tmp_path, recording, script).outcome == "finished"
    assert not alive(int((tmp_path / "out" / "log.txt").read_text()))


def alive(pid):
    for _ in range(50):  # it is reaped by init, a moment after it has ended
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.1)
    return True


def test_a_run_that_is_stopped_leaves_no_record(tmp_path, recording):
    stop = threading.Event()
    threading.Timer(0.3, stop.set).start()
    system = script_system(tmp_path / "system", "time.sleep(60)")
    refused(run_system, system, recording, tmp_path / "out", stop=stop, names="scripted", error=InterruptedRunError)
    assert not (tmp_path / "out" / "run.json").exists()
    assert run_system(script_system(tmp_path / "system", GOOD), recording, tmp_path / "out").outcome == "finished"


def test_a_log_is_bounded(tmp_path, recording):
    record = ended(tmp_path, recording, GOOD + "print('first')\nprint(*range(200_000), sep=chr(10))\nprint('last')")
    assert record.outcome == "finished"
    log = (tmp_path / "out" / "log.txt").read_text()
    assert log.startswith("first\n0\n1\n")
    assert log.endswith("199999\nlast\n")
    assert "bytes are left out here" in log
    assert len(log) < 700_000


def test_an_earlier_run_leaves_nothing(tmp_path, recording):
    ended(tmp_path, recording, GOOD)
    assert ended(tmp_path, recording, "pass").outcome == "no_estimate"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"run.json", "log.txt"}


def test_modalities_that_a_system_does_not_read_are_not_named(tmp_path, recording):
    script = "assert all(f['depth'] is None and f['colour'] for f in frames)\n" + GOOD
    assert ended(tmp_path, recording, script, reads={"modalities": ["colour"]}).outcome == "finished"


def test_a_map_that_nobody_asked_for_is_left_out(tmp_path, recording):
    ended(tmp_path, recording, GOOD + "write(' '.join(sys.argv[2:]) or 'none', 'map.ply')", map_arguments=["--map"])
    assert not (tmp_path / "out" / "map.ply").exists()


def test_variables_and_threads(tmp_path, recording):
    script = GOOD + "print(os.environ['MINE'], os.environ['OMP_NUM_THREADS'])"
    ended(tmp_path, recording, script, variables=["MINE=a=b"], threads=2)
    assert (tmp_path / "out" / "log.txt").read_text() == "a=b 2\n"


def test_what_is_no_sequence(tmp_path):
    refused(run_system, script_system(tmp_path / "system", GOOD), tmp_path, tmp_path / "out", names=f"{tmp_path}: ")


CONVENTIONS = [
    ({"format": "kitti"}, "write(''.join(f'1 0 0 {k / 100} 0 1 0 0 0 0 1 0\\n' for k in range(5)))"),
    ({"format": "euroc"}, "write(''.join(f'{round(k * 5e7)},{k / 100},0,0,1,0,0,0\\n' for k in range(5)))"),
    ({"stamps": "index"}, "write(''.join(f'{k} {k / 100} 0 0 0 0 0 1\\n' for k in range(5)))"),
    ({"stamps": "none"}, "write(''.join(f'{k + 7} {k / 100} 0 0 0 0 0 1\\n' for k in range(5)))"),
    ({"direction": "w2c"}, "write(''.join(line(frame, -frame['index'] / 100) for frame in frames))"),
    ({"axes": "opengl"}, "write(''.join(line(f, f['index'] / 100).replace('0 0 0 1', '1 0 0 0') for f in frames))"),
    (
        {"file": "run-*/*.txt"},
        "os.mkdir('run-7')\nwrite(''.join(line(f, f['index'] / 100) for f in frames), 'run-7/a.txt')",
    ),
]


@pytest.mark.parametrize(("writes", "script"), CONVENTIONS, ids=[str(writes) for writes, _ in CONVENTIONS])
def test_formats_and_conventions(tmp_path, recording, writes, script):
    record = ended(tmp_path, recording, script, writes={"file": "poses.txt", **writes})
    assert (record.outcome, record.detail) == ("finished", "")
    estimate = read_estimate_file(tmp_path / "out" / "estimate.txt")
    assert estimate.stamps_s.tolist() == [0.0, 0.05, 0.1, 0.15, 0.2]
    assert estimate.c2w[:, :3, 3].tolist() == [[k / 100, 0.0, 0.0] for k in range(5)]
    assert abs(estimate.c2w[:, :3, :3] - np.eye(3)).max() < 1e-15


def test_poses_without_stamps_have_to_be_those_of_all_frames(tmp_path, recording):
    writes = {"file": "poses.txt", "format": "kitti"}
    record = ended(tmp_path, recording, "write('1 0 0 0 0 1 0 0 0 0 1 0\\n')", writes=writes)
    assert record.outcome == "unreadable"
    assert record.detail == "poses.txt: has 1 poses for 5 frames"
