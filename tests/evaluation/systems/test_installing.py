# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world systems`: what is listed, and how an environment comes to be, with programs that stand in for Python."""

import json
import os

import pytest
from refusals import refused

from noisy_world.cli import command
from noisy_world.core.errors import MissingDependencyError, StorageError
from noisy_world.core.packages import shipped
from noisy_world.evaluate import system_installation
from noisy_world.evaluate import systems as environments
from noisy_world.evaluate.system_runs import system_versions

TEXT = "10 6 0 0\n"

# Answers for its version, makes an environment with a copy of itself, and writes down what its pip is asked for.
PYTHON = """#!/bin/sh
case "$*" in
  *sys.version_info*) echo {version} ;;
  "-m venv "*) mkdir -p "$3/bin" && : >"$3/pyvenv.cfg" && cp "$0" "$3/bin/python" ;;
  "-m pip "*)
    echo "$*" >>"${{0%/bin/*}}/asked"
    test -z "$NO_INDEX" || {{ echo "ERROR: No matching distribution found"; echo "a notice"; exit 1; }} ;;
esac
"""


def program(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return str(path)


@pytest.fixture
def python(tmp_path):
    return program(tmp_path / "bin/python3.12", PYTHON.format(version="3.12"))


@pytest.fixture(autouse=True)
def trained(monkeypatch):
    monkeypatch.setattr(system_installation, "train", lambda: TEXT)


def make(folder, python=None):
    return system_installation.install(folder, python, lambda _: None)


def test_an_environment_is_made_once_and_anew_where_it_is_not_whole(tmp_path, python, monkeypatch):
    folder = tmp_path / "environments/.venv-slam"
    monkeypatch.setenv("NO_INDEX", "1")
    refused(make, folder, python, names=[str(folder), "No matching distribution found"], error=StorageError)
    monkeypatch.delenv("NO_INDEX")
    assert make(folder, python)
    (asked,) = (folder / "asked").read_text().splitlines()  # what was made half has gone
    assert {"--no-deps", "--require-hashes", str(shipped("requirements/slam.lock"))} <= set(asked.split())
    assert (folder / "orb_vocabulary.txt").read_text() == TEXT
    (folder / "mine").touch()
    assert not make(folder)
    (folder / "orb_vocabulary.txt").unlink()
    assert make(folder)
    assert (folder / "mine").exists(), "the packages were there"
    for damage in (
        lambda: (folder / ".installed").write_text("of another lock file"),
        (folder / ".unfinished").touch,
        lambda: (folder / "bin/python").write_text("#!/bin/sh\nexit 1"),
    ):
        (folder / "mine").touch()
        damage()
        assert make(folder, python)
        assert not (folder / "mine").exists()


def test_what_is_no_environment_is_not_removed(tmp_path, python):
    (tmp_path / "thesis.tex").touch()
    refused(make, tmp_path, python, names=str(tmp_path), error=StorageError)
    assert (tmp_path / "thesis.tex").exists()


def test_a_python_is_found_or_one_line_says_how_to_get_one(tmp_path, python, monkeypatch):
    monkeypatch.setattr(system_installation, "PYTHONS", ("3.98", "3.99"))  # neither is on any machine
    monkeypatch.setenv("PATH", f"{tmp_path}/shims:{os.environ['PATH']}")
    names = ["uv python install 3.12", "--python", "Containerfile"]
    refused(system_installation.usable_python, names=names, error=MissingDependencyError)
    refused(make, tmp_path / "new", python, names=["--python: ", "3.12", "3.98 or 3.99"])
    refused(make, tmp_path / "new", str(tmp_path / "nowhere"), names=["--python: ", "nowhere"])
    assert not (tmp_path / "new").exists()
    of_uv = program(tmp_path / "uv/python", PYTHON.format(version="3.99"))
    program(tmp_path / "shims/python3.98", "#!/bin/sh\necho 'python3.98: command not found' >&2\nexit 127")
    program(tmp_path / "shims/uv", f'#!/bin/sh\ntest "$*" = "python find 3.99" && echo {of_uv}')
    assert system_installation.usable_python() == of_uv
    on_path = program(tmp_path / "shims/python3.99", PYTHON.format(version="3.99"))
    assert system_installation.usable_python() == on_path


def test_environments_lie_where_they_are_found_again(tmp_path, monkeypatch):
    monkeypatch.delenv("NOISY_WORLD_ENVIRONMENTS", raising=False)
    assert environments.environment_folder("slam") == shipped("requirements/slam.lock").parents[1] / ".venv-slam"
    monkeypatch.setattr(environments, "checkout", lambda: None)
    monkeypatch.setattr(environments.sys, "platform", "linux")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for given in ("", "relative"):
        monkeypatch.setenv("XDG_DATA_HOME", given)
        assert environments.environment_folder("slam") == tmp_path / "home/.local/share/noisy-world/.venv-slam"
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert environments.environment_folder("slam") == tmp_path / "data/noisy-world/.venv-slam"
    (tmp_path / ".venv-slam").mkdir()
    assert environments.environment_folder("slam") == tmp_path / ".venv-slam"
    monkeypatch.setenv("NOISY_WORLD_ENVIRONMENTS", str(tmp_path / "named"))
    assert environments.environment_folder("slam") == tmp_path / "named/.venv-slam"


@pytest.fixture
def asked_anew():
    """What systems say of their versions is remembered: not here, and nothing of here afterwards."""
    system_versions.cache_clear()
    yield
    system_versions.cache_clear()


@pytest.mark.usefixtures("asked_anew")
def test_the_command_lists_and_installs(tmp_path, python, monkeypatch, capfd):
    monkeypatch.setenv("NOISY_WORLD_ENVIRONMENTS", str(tmp_path / "named"))
    monkeypatch.setattr("noisy_world.cli.entry.blender_problem", lambda entry: "")

    def systems(*words):
        status = command.main(["systems", *map(str, words)])
        return status, *capfd.readouterr()

    status, listed, _ = systems()
    assert status == 0
    assert "rgbd_odometry: can be run here\n" in listed
    remedy = "run: noisy-world systems install orb_slam3\n"
    assert f"orb_slam3: cannot be run here: there is no environment {tmp_path}/named/.venv-slam\n" in listed
    assert remedy in listed
    assert systems("install", "rgbd_odometry")[:2] == (0, "rgbd_odometry needs no installation\n")
    status, _, said = systems("install", "imap")
    assert (status, said.count("\n")) == (1, 1)
    assert "docs/other_systems.md" in said
    status, told, _ = systems("install", "orb_slam3", "--into", tmp_path / "other", "--python", python)
    assert status == 0
    assert told.endswith(f"export NOISY_WORLD_ENVIRONMENTS={tmp_path}/other\n")
    # One that is made where it is looked for is asked whether it runs; this stand-in tells no versions.
    status, told, said = systems("install", "orb_slam3", "--python", python)
    assert status == 1
    assert told == f"installed {tmp_path}/named/.venv-slam\n"
    assert "system orb_slam3 cannot be run here: its command for versions" in said
    monkeypatch.setattr("noisy_world.cli.system_libraries.provide", lambda whose, find: f"{whose} needs {find()}")
    status, _, said = systems("install", "orb_slam3", "--python", python)
    assert (status, said) == (1, f"noisy-world systems: orb_slam3, in {tmp_path}/named/.venv-slam, needs []\n")
    versions = json.dumps({"orb_slam3": "1"})
    program(tmp_path / "named/.venv-slam/bin/python", f"#!/bin/sh\necho '{versions}'")
    assert "orb_slam3: can be run here\n" in systems()[1]
