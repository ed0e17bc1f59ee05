"""Definitions of systems: what they may say, and the one line where they say something else."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest
import yaml
from refusals import refused

from noisy_world.core.errors import MissingDependencyError
from noisy_world.core.packages import PACKAGE
from noisy_world.evaluate.system_runs import check_system
from noisy_world.evaluate.systems import (
    SHIPPED,
    ExpectedClean,
    filled,
    find_system,
    find_systems,
    read_system,
    shipped_names,
)

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
    ("keys", "key", "names"),
    [
        ({"comand": ["x"]}, "comand", ["'command'"]),
        ({"name": "My System"}, "name", ["'My System'", "digits"]),
        ({"command": []}, "command", ["empty"]),
        ({"command": "run"}, "command", ["'run'", "list"]),
        ({"command": ["run", "{image}"]}, "command.1", ["{image}", "{python}, {frames}"]),
        ({"command": ["run", "{sequence}"]}, "command.1", ["{sequence}", "reads.layouts"]),
        ({"command": ["run", "{environment}"]}, "command.1", ["{environment}"]),
        ({"reads": {"modalities": ["rgb"]}}, "reads.modalities.0", ["'rgb'"]),
        ({"reads": {"modalities": []}}, "reads.modalities", ["empty"]),
        ({"reads": {"layouts": ["icl_nuim"]}}, "reads.layouts.0", ["'icl_nuim'"]),
        ({"writes": {"file": "../poses.txt"}}, "writes.file", ["'../poses.txt'"]),
        ({"writes": {"file": "/poses.txt"}}, "writes.file", ["'/poses.txt'"]),
        ({"writes": {"file": "a", "keyframes": "/b"}}, "writes.keyframes", ["'/b'"]),
        ({"writes": {"file": "a", "format": "tumm"}}, "writes.format", ["'tumm'", "'tum'"]),
        ({"variables": ["OMP_NUM_THREADS: 1"]}, "variables.0", ["'OMP_NUM_THREADS: 1'", "NAME=VALUE"]),
        ({"time_limit": {"frame_s": -1}}, "time_limit.frame_s", ["-1"]),
        ({"threads": 0}, "threads", ["0", "at least 1"]),
        ({"environment": "../x"}, "environment", ["'../x'"]),
        ({"file": "x"}, "file", ["writes.file"]),
    ],
)
def test_what_is_wrong_is_one_line_with_file_and_key(tmp_path, keys, key, names):
    path = written(tmp_path, **keys)
    refused(read_system, path, names=[f"{path}: {key}: ", *names])


def test_a_definition_that_is_not_there(tmp_path):
    refused(find_system, str(tmp_path / "none.yaml"), names="none.yaml: ")
    refused(find_system, "orb_slam4", names=["--systems: ", "'orb_slam4'", "'orb_slam"])


def test_lists_of_systems(tmp_path):
    path = str(written(tmp_path))
    (tmp_path / "other").mkdir()
    other = written(tmp_path / "other")
    assert [system.name for system in find_systems(["rgbd_odometry", path, path])] == ["rgbd_odometry", "mine"]
    refused(find_systems, [path, str(other)], names=["mine", "rename"])


def test_the_digest_is_of_what_counts(tmp_path):
    digest = read_system(written(tmp_path)).digest
    assert read_system(written(tmp_path, about="words", remedy="more words", versions=["true"])).digest == digest
    assert read_system(written(tmp_path, expects_clean={"ate_m": 0.01})).digest == digest
    assert read_system(written(tmp_path, threads=2)).digest != digest
    assert read_system(written(tmp_path, command=["run", "{frames}", "-v"])).digest != digest
    assert read_system(written(tmp_path, repeatable=True, gpu=False)).digest == digest
    (tmp_path / "elsewhere").mkdir()
    assert read_system(written(tmp_path / "elsewhere")).digest == digest


def test_a_study_of_before_its_programs_moved_grows(tmp_path):
    # As release 0.1.0's definition has it, and its digest.
    assert find_system("rgbd_odometry").digest.startswith("5658c06b8455")
    assert find_system("splatam_s").digest.startswith("7b2f3316c192")
    before = find_system("rgbd_odometry").command[2].replace("evaluate", "evaluation")
    older = read_system(written(tmp_path, command=["{python}", "-m", before, "{frames}", "{out}"]))
    assert filled(older.command[2:3], {}) == ["noisy_world.evaluate.odometry"]


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
    def missing(names, **keys):
        refused(check_system, read_system(written(tmp_path, **keys)), names=names, error=MissingDependencyError)

    missing(["mine", "nowhere/run"], command=["nowhere/run"])
    monkeypatch.setenv("NOISY_WORLD_ENVIRONMENTS", str(tmp_path))
    missing([f"{tmp_path}/.venv-other", "run: make it"], environment="other", remedy="run: make it")
    monkeypatch.setattr("noisy_world.evaluate.system_runs.GPU_DEVICES", ())
    missing(["mine", "NVIDIA GPU"], command=["sh"], gpu=True)


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
    refused(check_system, system, names=["mine", message], error=MissingDependencyError)


def test_systems_can_be_named_where_none_can_be_run():
    """Windows has no module `resource`, and names systems nevertheless."""
    script = "import sys; sys.modules['resource'] = None; import noisy_world.evaluate.study"
    subprocess.run([sys.executable, "-c", script], check=True, env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)})
