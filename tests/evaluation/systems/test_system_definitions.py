"""Definitions of systems: what they may say, and the one line where they say something else."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest
import yaml

from noisy_world.core.errors import InputError, MissingDependencyError
from noisy_world.evaluation.systems.checking import PACKAGE_FOLDER, check_system
from noisy_world.evaluation.systems.definition import ExpectedClean, filled, read_system
from noisy_world.evaluation.systems.registry import SHIPPED, find_system, find_systems, shipped_names

LEAST = {"name": "mine", "command": ["run", "{frames}"], "writes": {"file": "poses.txt"}}


def written(folder, **keys):
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump({**LEAST, **keys}))
    return path


def test_the_least_definition(tmp_path):
    system = find_system(str(written(tmp_path)))
    assert (system.name, system.command, system.writes.file) == ("mine", ("run", "{frames}"), "poses.txt")
    assert system.reads.modalities == ("colour", "depth")
    assert not system.reads.monocular
    assert system.repeatable
    assert not system.gpu
    assert system.time_limit.of(100) == 120 + 10 * 100
    assert system.file == tmp_path / "mine.yaml"


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"comand": ["x"]}, "comand: unknown key 'comand'; did you mean 'command'"),
        ({"name": "My System"}, "name: 'My System' is no name: small letters, digits, _ and -, at most 64"),
        ({"command": []}, "command: is empty"),
        ({"command": "run"}, "command: is the text 'run', but has to be a list"),
        ({"command": ["run", "{image}"]}, "command.1: {image} is no placeholder; known: {python}, {frames}"),
        ({"command": ["run", "{sequence}"]}, "command.1: names {sequence}, but reads.layouts is empty"),
        ({"command": ["run", "{environment}"]}, "command.1: names {environment}, but there is none"),
        ({"reads": {"modalities": ["rgb"]}}, "reads.modalities.0: unknown value 'rgb'"),
        ({"reads": {"modalities": []}}, "reads.modalities: is empty"),
        ({"reads": {"layouts": ["scannet"]}}, "reads.layouts.0: 'scannet' is no layout"),
        ({"writes": {"file": "../poses.txt"}}, "writes.file: '../poses.txt' is no file inside the folder"),
        ({"writes": {"file": "/poses.txt"}}, "writes.file: '/poses.txt' is no file inside the folder"),
        ({"writes": {"file": "a", "keyframes": "/b"}}, "writes.keyframes: '/b' is no file inside the folder"),
        ({"writes": {"file": "a", "format": "tumm"}}, "writes.format: unknown value 'tumm'; did you mean 'tum'?"),
        ({"variables": ["OMP_NUM_THREADS: 1"]}, "variables.0: 'OMP_NUM_THREADS: 1' is no NAME=VALUE"),
        ({"time_limit": {"frame_s": -1}}, "time_limit.frame_s: is -1"),
        ({"threads": 0}, "threads: is 0, out of range; allowed: at least 1"),
        ({"environment": "../x"}, "environment: '../x' is no name"),
        ({"file": "x"}, "file: is no key of a system; the file of the estimate is writes.file"),
    ],
)
def test_what_is_wrong_is_one_line_with_file_and_key(tmp_path, keys, message):
    path = written(tmp_path, **keys)
    with pytest.raises(InputError) as caught:
        read_system(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert "\n" not in str(caught.value)


def test_a_definition_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml: cannot be read: No such file"):
        find_system(str(tmp_path / "none.yaml"))
    with pytest.raises(InputError, match=r"--systems: unknown system 'orb_slam4'; did you mean 'orb_slam"):
        find_system("orb_slam4")


def test_lists_of_systems(tmp_path):
    path = str(written(tmp_path))
    (tmp_path / "other").mkdir()
    other = written(tmp_path / "other")
    assert [system.name for system in find_systems(["rgbd_odometry", path, path])] == ["rgbd_odometry", "mine"]
    with pytest.raises(InputError, match="second system called mine; rename one"):
        find_systems([path, str(other)])


def test_the_digest_is_of_what_counts(tmp_path):
    digest = read_system(written(tmp_path)).digest
    assert read_system(written(tmp_path, about="words", remedy="more words", versions=["true"])).digest == digest
    assert read_system(written(tmp_path, expects_clean={"ate_m": 0.01})).digest == digest
    assert read_system(written(tmp_path, threads=2)).digest != digest
    assert read_system(written(tmp_path, command=["run", "{frames}", "-v"])).digest != digest
    assert read_system(written(tmp_path, repeatable=True, gpu=False)).digest == digest
    (tmp_path / "elsewhere").mkdir()
    assert read_system(written(tmp_path / "elsewhere")).digest == digest


def test_the_shipped_systems_are_named_like_their_files():
    assert {"orb_slam3", "orb_slam3_mono", "plain_odometry", "rgbd_odometry"} <= set(shipped_names())
    for name in shipped_names():
        system = find_system(name)
        assert system.name == name
        assert system.about.endswith(".")
        assert system.file == SHIPPED / f"{name}.yaml"
    assert find_system("orb_slam3_mono").reads.monocular
    assert not find_system("orb_slam3").repeatable
    orb_slam3 = find_system("orb_slam3")
    assert orb_slam3.expects_clean == ExpectedClean(ate_m=0.01, scale_off=0.01)
    other_slope = tuple("0.6" if word == "0.5" else word for word in orb_slam3.command)
    assert replace(orb_slam3, command=other_slope).digest != orb_slam3.digest  # the rule of depth's weight is in it


def test_placeholders_are_filled_in_and_other_braces_stay():
    assert filled(("a", "{out}/x", "{frames}{out}", "{ 1 }"), {"out": "/o", "frames": "f"}) == [
        *("a", "/o/x", "f/o", "{ 1 }")
    ]


def test_a_system_that_cannot_run_here_is_one_line_with_its_remedy(tmp_path, monkeypatch):
    remedy = "run: make it"
    with pytest.raises(MissingDependencyError, match="system mine cannot be run here: there is no program nowhere/run"):
        check_system(read_system(written(tmp_path, command=["nowhere/run"])))
    monkeypatch.setenv("NOISY_WORLD_ENVIRONMENTS", str(tmp_path))
    with pytest.raises(MissingDependencyError, match=rf"there is no environment {tmp_path}/\.venv-other; {remedy}"):
        check_system(read_system(written(tmp_path, environment="other", remedy=remedy)))
    monkeypatch.setattr("noisy_world.evaluation.systems.checking.GPU_DEVICES", ())
    with pytest.raises(MissingDependencyError, match="no NVIDIA GPU is here"):
        check_system(read_system(written(tmp_path, command=["sh"], gpu=True)))


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ('echo of the library; echo \'{"b": "2", "a": "1"}\'', None),
        ("echo no module named x >&2; exit 3", "no module named x"),
        ("exit 3", "its command for versions ended with 3"),
        ("echo 1.0", "its command for versions does not print a JSON object"),
        ("true", "its command for versions does not print a JSON object"),
    ],
)
def test_versions_are_asked_before_anything_is_run(tmp_path, script, message):
    system = read_system(written(tmp_path, command=["sh"], versions=["sh", "-c", script]))
    if message is None:
        assert check_system(system) == {"a": "1", "b": "2"}
        return
    with pytest.raises(MissingDependencyError, match=message):
        check_system(system)


def test_systems_can_be_named_where_none_can_be_run():
    """Windows has no module `resource`, and names systems nevertheless."""
    script = "import sys; sys.modules['resource'] = None; import noisy_world.evaluation.study.study"
    subprocess.run([sys.executable, "-c", script], check=True, env={**os.environ, "PYTHONPATH": str(PACKAGE_FOLDER)})
