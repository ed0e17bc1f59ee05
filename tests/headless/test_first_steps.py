# SPDX-License-Identifier: GPL-3.0-or-later
"""What a newcomer asks for: files to begin with, pages, completion and manual pages."""

import os
import re
import runpy
import shutil
import subprocess

import pytest
from worlds import ROOT

from noisy_world.cli import command, first_steps
from noisy_world.preset.keys import read_preset
from noisy_world.testing import check_perturbation, check_system


def lines_of(capsys, *words, status=0):
    assert command.main(list(map(str, words))) == status
    return capsys.readouterr().out.splitlines()


def test_examples_are_listed_with_a_sentence(capsys):
    listed = dict(line.split(maxsplit=1) for line in lines_of(capsys, "example"))
    assert {"tour", "footage", "my_slam", "my_noise", "own_images"} <= listed.keys()
    for name, rest in listed.items():
        files, _, about = rest.partition(": ")
        assert all((ROOT / "docs/examples" / file).exists() for file in files.split(", ")), name
        assert len(about.split()) > 3, name


def test_a_preset_to_begin_with(tmp_path, capsys):
    assert lines_of(capsys, "example", "tour.yaml", "--out", tmp_path) == [f"wrote {tmp_path / 'tour.yaml'}"]
    assert read_preset(tmp_path / "tour.yaml", []).spec.seed == 11
    (tmp_path / "tour.yaml").write_text("mine")
    assert command.main(["example", "tour", "--out", str(tmp_path)]) == 1
    assert "tour.yaml: is there already; --overwrite replaces it" in capsys.readouterr().err
    assert (tmp_path / "tour.yaml").read_text() == "mine"
    lines_of(capsys, "example", "tour", "--out", tmp_path, "--overwrite")
    assert (tmp_path / "tour.yaml").read_text() != "mine"


def test_a_system_to_begin_with_runs(tmp_path, capsys):
    lines_of(capsys, "example", "my_slam", "--out", tmp_path / "mine")
    check_system(tmp_path / "mine/my_slam.yaml", tmp_path / "work")


def test_a_perturbation_to_begin_with_keeps_the_rules(tmp_path, capsys):
    lines_of(capsys, "example", "my_noise", "--out", tmp_path)
    names = {path.relative_to(tmp_path).as_posix() for path in (tmp_path / "my_noise").rglob("*.*")}
    assert {"my_noise/pyproject.toml", "my_noise/test_rules.py", "my_noise/my_noise/__init__.py"} <= names
    check_perturbation(runpy.run_path(str(tmp_path / "my_noise/my_noise/stereo_steps.py"))["PERTURBATION"])


def test_pages_are_named_and_printed(capsys):
    listed = dict(line.split(maxsplit=1) for line in lines_of(capsys, "docs"))
    assert listed["tutorial"] == (ROOT / "docs/tutorial.md").read_text().splitlines()[0].lstrip("# ")
    told = lines_of(capsys, "docs", "tutorial.md")
    assert "scenes:" in (ROOT / "docs/examples/tour.yaml").read_text().splitlines()
    assert "scenes:" in told  # the file that the page shows
    assert not [line for line in told if line.startswith("--8<--")]


def test_where_pages_are_when_none_came_along(monkeypatch, capsys):
    monkeypatch.setattr(first_steps, "found_shipped", lambda name: None)
    for address, where in (("", "they are in the project's folder docs"), ("there", "read them at there")):
        monkeypatch.setattr(first_steps, "project_address", lambda address=address: address)
        assert command.main(["docs"]) == 1
        assert capsys.readouterr().err.endswith(f"do not come along with this installation; {where}\n")
    assert lines_of(capsys, "example") == []


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["example", "tuor"], "tuor: no such example; did you mean 'tour'?"),
        (["docs", "recordngs"], "recordngs: no such page; did you mean 'recordings'?"),
    ],
)
def test_what_there_is_not(words, said, capsys):
    assert command.main(words) == 1
    assert capsys.readouterr().err == f"noisy-world {words[0]}: {said}\n"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["describ"], "describe"),
        (["generate", "--sc"], "--scratch --scenes"),
        (["generate", "--progress", ""], "text json"),
        (["list", "key"], "keys"),
    ],
)
def test_bash_completes(words, expected, tmp_path, capsys):
    if shutil.which("bash") is None:
        pytest.skip("no bash here")
    script = tmp_path / "completion"
    script.write_text("\n".join(lines_of(capsys, "completion", "bash")))
    ask = 'source "$1"; COMP_WORDS=(noisy-world "${@:2}"); COMP_CWORD=$(($# - 1)); _noisy_world; echo ${COMPREPLY[@]}'
    done = subprocess.run(["bash", "-c", ask, "bash", script, *words], capture_output=True, text=True, check=True)
    assert (done.stdout.strip(), done.stderr) == (expected, "")


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_know_every_subcommand(shell, tmp_path, capsys):
    told = lines_of(capsys, "completion", shell)
    for name, item in command.COMMANDS.items():
        assert any(name in line and item.help.split("'")[0][:20] in line for line in told), name
    if shutil.which(shell):
        script = tmp_path / "completion"
        script.write_text("\n".join(told))
        subprocess.run([shell, "-n", script], check=True)


def test_manual_pages_are_troff(tmp_path, capsys):
    lines_of(capsys, "docs", "--man", tmp_path)
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {f"noisy-world-{name}.1" for name in command.COMMANDS}
    if shutil.which("groff") is None:
        pytest.skip("no groff here, which sets the pages")
    pages = [tmp_path / "noisy-world-generate.1", tmp_path / "noisy-world-check.1"]
    words = ["groff", "-man", "-ww", "-Tascii", *pages]
    done = subprocess.run(words, capture_output=True, text=True, check=True, env={**os.environ, "GROFF_NO_SGR": "1"})
    assert done.stderr == ""
    assert "--set KEY.PATH=VALUE" in re.sub(".\b", "", done.stdout)  # bold is struck twice
