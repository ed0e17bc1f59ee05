# SPDX-License-Identifier: GPL-3.0-or-later
"""The command, and the wheel that installs it: what that holds, and what it makes when it is started from elsewhere."""

import os
import signal
import subprocess
import sys
import tomllib
import zipfile

import pytest
import yaml
from worlds import ROOT, content, write_world

from noisy_world.cli import command
from noisy_world.cli.entry import exit_status
from noisy_world.cli.arguments import found_preset

VERSION = tomllib.loads((ROOT / "blender_manifest.toml").read_text())["version"]


def run(words, **options):
    return subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=300, check=False, **options)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    pytest.importorskip("hatchling", reason="hatchling, which builds the wheel, is not installed")
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "wheel", "--no-build-isolation", "--no-deps", "--no-index", "-w", folder, ROOT]
    built = run(pip)
    assert built.returncode == 0, built.stderr
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A folder with the package alone, and the environment of a process that finds it there and nowhere else."""
    folder = tmp_path_factory.mktemp("site")
    done = run([sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--target", folder, wheel])
    assert done.returncode == 0, done.stderr
    return folder, {**os.environ, "PYTHONPATH": str(folder)}


@pytest.mark.long
def test_what_the_wheel_holds(wheel):
    assert wheel.name == f"noisy_world-{VERSION}-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as packed:
        names = packed.namelist()
        metadata = packed.read(f"noisy_world-{VERSION}.dist-info/METADATA").decode()
        entry = packed.read(f"noisy_world-{VERSION}.dist-info/entry_points.txt").decode()
    held = {
        f"noisy_world/{name}"
        for name in (
            *("py.typed", "__main__.py", "requirements/slam.lock", "perturbations/shipped/ice/rime.jpg"),
            *("docs/tutorial.md", "docs/examples/tour.yaml", "docs/examples/my_noise/pyproject.toml", "CHANGELOG.md"),
        )
    }
    shipped = {path.relative_to(ROOT).as_posix() for path in (ROOT / "presets").rglob("*.yaml")}
    assert held | {f"noisy_world/{name}" for name in shipped} <= set(names)
    assert "noisy-world = noisy_world.cli.command:main" in entry
    assert "License-Expression: GPL-3.0-or-later" in metadata
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    required = {
        line.removeprefix("Requires-Dist: ").lower() for line in metadata.splitlines() if "Requires-Dist" in line
    }
    assert {text.lower() for text in project["dependencies"]} <= required
    tops = {name.split("/")[0] for name in names}
    assert tops == {"noisy_world", f"noisy_world-{VERSION}.dist-info"}
    assert not [name for name in names if "__pycache__" in name or "/assets/" in name or name.endswith("ruff.toml")]


@pytest.mark.long
def test_the_installed_command_from_another_folder(installed, tmp_path):
    site, environment = installed
    script = site / "bin" / "noisy-world"
    told = run([sys.executable, script, "--version"], env=environment, cwd=tmp_path)
    assert told.stdout == f"noisy-world {VERSION}\n", told.stderr
    told = run([sys.executable, script, "generate", "presets/demo.yaml", "--list"], env=environment, cwd=tmp_path)
    assert told.returncode == 0, told.stderr
    assert told.stderr == (
        "presets/demo.yaml: not in this folder; taking the one that comes with Noisy World, "
        f"{site / 'noisy_world/presets/demo.yaml'}\n"
    )
    assert "clean/" in told.stdout
    told = run([sys.executable, "-m", "noisy_world", "list", "presets"], env=environment, cwd=tmp_path)
    assert [line.split()[0] for line in told.stdout.splitlines()] == sorted(
        path.relative_to(ROOT).as_posix() for path in (ROOT / "presets").rglob("*.yaml")
    )


@pytest.mark.long
def test_the_installed_command_and_its_workers_write_what_the_script_writes(installed, tmp_path):
    _, environment = installed
    preset = write_world(tmp_path / "world", frames=4)
    arguments = [preset, "--set", "output.overview=false"]
    command_ = [sys.executable, "-m", "noisy_world", "generate", *arguments, "--out", tmp_path / "a", "--jobs", 2]
    made = run(command_, env=environment, cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    made = run([sys.executable, ROOT / "headless/generate.py", *arguments, "--out", tmp_path / "b"])
    assert made.returncode == 0, made.stderr
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_a_preset_of_ones_own_comes_before_the_shipped_one(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "presets" / "demo.yaml"
    own.parent.mkdir()
    own.write_text("")
    assert found_preset(own.relative_to(tmp_path)) == own.relative_to(tmp_path)
    nowhere = own.with_name("nowhere.yaml").relative_to(tmp_path)
    assert found_preset(nowhere) == nowhere
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        ([], 2, "usage: noisy-world SUBCOMMAND"),
        (["generat"], 2, "noisy-world: 'generat' is no subcommand; did you mean 'generate'?"),
        (
            ["qwzx"],
            2,
            "noisy-world: 'qwzx' is no subcommand; there are example, docs, completion, generate, ",
        ),
        (["materialise"], 2, "did you mean 'remake'?"),
        (["clean"], 2, "did you mean 'render-clean'?"),
        (["track"], 2, "did you mean 'run-odometry'?"),
        (
            ["generate", "demo.yml"],
            1,
            "noisy-world generate: demo.yml: no such preset; did you mean 'presets/demo.yaml'",
        ),
        (["generate", "qwzx/qwzx"], 1, "no such preset; 'noisy-world list presets' names those that are shipped"),
        (["evaluate", "stdy.yaml", "--systems", "rgbd_odometry"], 1, "did you mean 'presets/study.yaml'?"),
        (["publish", "nowhere", "there"], 1, "noisy-world publish: nowhere: holds no dataset of Noisy World"),
        (["list", "perturbations"], 0, "gaussian_noise"),
        (["export", "nowhere.ply", "out.ply"], 1, "noisy-world export: nowhere.ply"),
    ],
)
def test_the_command(words, status, said, capsys):
    assert command.main(words) == status
    out, err = capsys.readouterr()
    assert said in out + err


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["--help"], 0, "evaluate SLAM systems:\n  evaluate "),
        (["--version"], 0, "noisy-world 0."),
        (["--verson"], 2, "noisy-world: error: unknown option --verson; did you mean --version?\n"),
        (
            ["generate", "a.yaml", "--frame=0:2", "--jbos", "2"],
            2,
            "error: unknown option --jbos; did you mean --jobs?\n",
        ),
        (["list", "kyes"], 2, "error: argument WHAT: 'kyes' is none of its values; did you mean 'keys'?\n"),
        (
            ["plan", "a", "--format=xml"],
            2,
            "'xml' is none of its values; choose from text, json; 'noisy-world plan --help",
        ),
        (["verify", "a", "b", "c"], 2, "error: 'c' is one word too many; 'noisy-world verify --help' tells more\n"),
        (["generate", "a.yaml", "--workr"], 2, "unknown option --workr"),
        (["list", "settings"], 2, "noisy-world list: error: settings: name a preset"),
    ],
)
def test_words_that_the_parser_ends_with(words, status, said, capsys):
    with pytest.raises(SystemExit) as ended:
        command.main(words)
    out, err = capsys.readouterr()
    assert ended.value.code == status
    assert said in out + err
    assert status == 0 or err.count("\n") == 1
    assert "--worker" not in err  # is for the program itself


@pytest.mark.long
@pytest.mark.parametrize(
    "start", [["-m", "noisy_world"], [str(ROOT / "headless/generate.py")]], ids=["module", "script"]
)
@pytest.mark.parametrize("closed", ["stdout", "stderr"])
def test_a_command_whose_reader_is_gone_ends_as_unix_tools_do(start, closed):
    script = start[0] != "-m"
    listing = ["--list", "perturbations"] if script else ["list", "perturbations"]
    complaint = ["nowhere.yaml"] if script else ["generate", "nowhere.yaml"]
    reader, writer = os.pipe()
    os.close(reader)
    other = "stderr" if closed == "stdout" else "stdout"
    done = subprocess.run(
        [sys.executable, *start, *(listing if closed == "stdout" else complaint)],
        **{closed: writer, other: subprocess.PIPE},
        env={**os.environ, "PYTHONPATH": str(ROOT / "addon")},
        check=False,
    )
    os.close(writer)
    assert done.returncode == 128 + signal.SIGPIPE
    assert getattr(done, other) == b""


def test_a_broken_pipe_of_another_process_keeps_its_traceback():
    def work():
        raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        exit_status(work)


def test_defaults_are_listed_as_yaml_has_them(capsys):
    assert command.main(["list", "keys"]) == 0
    listed = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    told = {
        name: yaml.safe_load(text.rpartition("; default ")[2]) for name, text in listed.items() if "; default " in text
    }
    assert told["settings[]"] == [{"name": "clean"}]
    assert told["output.modalities[]"] == ["rgb", "depth"]
    assert told["render.allow_empty"] is False
    assert told["scenes[].compositor"] == "off"  # without quotes YAML reads false
    assert told["rig.rgb.translation_m"] == [0.0, 0.0, 0.0]
    assert "1000000 m" in listed["camera.near_m"]
    assert "0.000001 to" in listed["camera.near_m"]


def test_every_subcommand_has_help(capsys):
    for name in command.COMMANDS:
        with pytest.raises(SystemExit) as ended:
            command.main([name, "--help"])
        assert ended.value.code == 0
        assert f"usage: noisy-world {name}" in capsys.readouterr().out
