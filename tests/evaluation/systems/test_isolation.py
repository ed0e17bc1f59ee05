"""A system that is kept apart by bubblewrap reaches its own folder alone."""

import json
import sys
from pathlib import Path

import pytest
from refusals import refused
from slam_systems import script_system, write_recording

from noisy_world.core.errors import MissingDependencyError
from noisy_world.evaluate.system_isolation import isolation_problem
from noisy_world.evaluate.system_runs import run_system

GOOD = "write(''.join(line(frame, frame['index'] / 100) for frame in frames))\n"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("recording") / "room")


isolating = pytest.mark.skipif(bool(isolation_problem()), reason="bubblewrap is not here, or not permitted")


@isolating
def test_an_isolated_system_reaches_its_own_folder_alone(tmp_path, recording, monkeypatch):
    monkeypatch.setenv("SECRET_TOKEN", "12345")
    (tmp_path / "secret.txt").write_text("secret")
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "weights.bin").write_text("weights")
    places = {"recording": recording, "beside": tmp_path / "secret.txt", "home": Path.home(), "out": tmp_path / "out"}
    script = GOOD + (
        f"places = { ({name: str(path) for name, path in places.items()})!r}\n"
        "said = {name: sorted(os.listdir(path)) if os.path.isdir(path) else os.path.exists(path)\n"
        "        for name, path in places.items()}\n"
        "said['secret'] = os.environ.get('SECRET_TOKEN')\n"
        "said['mine'] = os.environ['MINE']\n"
        "said['weights'] = open(os.environ['WEIGHTS']).read()\n"
        "said['processes'] = len([name for name in os.listdir('/proc') if name.isdecimal()])\n"
        "tried = {'image': frames[0]['colour'], 'program': __file__, 'usr': '/usr/x', 'tmp': '/tmp/x'}\n"
        "for name, path in tried.items():\n"
        "    try:\n"
        "        open(path, 'ab').write(b'x')\n"
        "        said[name] = 'written'\n"
        "    except OSError as error:\n"
        "        said[name] = error.strerror\n"
        "import socket\n"
        "said['interfaces'] = [name for _, name in socket.if_nameindex()]\n"
        "print(json.dumps(said))\n"
        "if os.fork() == 0:\n"
        "    os.setsid(); time.sleep(600)\n"
    )
    weights = tmp_path / "more" / "weights.bin"
    system = script_system(
        tmp_path / "system",
        script,
        isolate="bubblewrap",
        reaches=[str(tmp_path / "more")],
        variables=["MINE=1", f"WEIGHTS={weights}"],
        versions=[sys.executable, "-c", "import os, json; print(json.dumps({'home': os.environ['HOME']}))"],
    )
    record = run_system(system, recording, tmp_path / "out")
    assert (record.outcome, record.detail, record.isolated) == ("finished", "", "bubblewrap"), (
        tmp_path / "out/log.txt"
    ).read_text()
    assert record.versions == {"home": "/tmp"}
    said = json.loads((tmp_path / "out" / "log.txt").read_text())
    assert said["recording"] is False
    assert said["beside"] is False
    assert said["home"] is False or "home" not in said["home"]
    assert said["out"] == [".work"]
    assert said["secret"] is None
    assert (said["mine"], said["weights"]) == ("1", "weights")
    assert said["processes"] <= 3
    assert {said[name] for name in ("image", "program", "usr")} == {"Read-only file system"}
    assert said["tmp"] == "written"
    assert said["interfaces"] == ["lo"]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"run.json", "log.txt", "estimate.txt"}


def test_isolation_that_is_not_there_is_one_line(tmp_path, recording, monkeypatch):
    isolation_problem.cache_clear()
    script = script_system(tmp_path / "system", GOOD, isolate="bubblewrap")
    try:
        monkeypatch.setattr("noisy_world.evaluate.system_isolation.PROGRAM", "no-such-program")
        arguments, error = (script, recording, tmp_path / "out"), MissingDependencyError
        refused(run_system, *arguments, names=["bubblewrap", "no-such-program"], error=error)
        isolation_problem.cache_clear()
        refusing = tmp_path / "refusing"
        refusing.write_text("#!/bin/sh\necho 'bwrap: No permissions to create new namespace' >&2; exit 1\n")
        refusing.chmod(0o700)
        monkeypatch.setattr("noisy_world.evaluate.system_isolation.PROGRAM", str(refusing))
        refused(run_system, *arguments, names="bwrap: No permissions to create new namespace", error=error)
    finally:
        isolation_problem.cache_clear()
    assert not (tmp_path / "out").exists()
