# SPDX-License-Identifier: GPL-3.0-or-later
"""`list` and `describe`: a line for each of what there is, or one thing whole."""

import pytest

from noisy_world.cli import command
from noisy_world.cli.known import KNOWN
from noisy_world.perturbations import registry


def lines_of(capsys, *words, status=0):
    assert command.main(list(words)) == status
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("what", KNOWN)
def test_everything_has_a_name_and_a_line(what, capsys):
    lines = lines_of(capsys, "list", what)
    assert len(lines) == len({line.split()[0] for line in lines})
    assert all(len(line.split()) > 1 for line in lines)


def test_list_alone_counts(capsys):
    counted = dict(line.split(maxsplit=1) for line in lines_of(capsys, "list"))
    assert counted.keys() == KNOWN.keys()
    assert counted["perturbations"].startswith(f"{len(registry())}, such as motion_deviation, ")


def test_one_of_them_whole(capsys):
    told = lines_of(capsys, "list", "perturbations", "fog")
    assert [line.split()[0] for line in told if not line.startswith(" ")] == ["fog"]
    assert "    colour, stage environment, order 10" in told
    assert any(line.startswith("    thickness: ") and "severities 1 to 5: 1.5, 2, 2.5, 2.5, 3" in line for line in told)


def test_a_branch_of_keys(capsys):
    names = [line.split()[0] for line in lines_of(capsys, "list", "keys", "camera")]
    assert {"camera", "camera.fx", "camera.distortion.k1"} <= set(names)
    assert all(name == "camera" or name.startswith("camera.") for name in names)


def test_describe_finds_it_wherever_it_is_listed(capsys):
    assert [line for line in lines_of(capsys, "describe", "tum") if line.endswith(":")] == ["layouts:", "formats:"]
    assert lines_of(capsys, "describe", "demo")[0] == "presets:"
    told = lines_of(capsys, "describe", "kinect_v1")
    assert told[0] == "cameras:"
    assert told[-1].endswith("kinect_v1.jpg")
    assert lines_of(capsys, "describe", "rig.imu")[0] == "keys:"
    assert lines_of(capsys, "describe", "generate")[0] == "subcommands:"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["list", "perturbations", "fgo"], "fgo: no such perturbation; did you mean 'fog'?"),
        (["list", "keys", "camera.widht"], "camera.widht: no such key; did you mean 'camera.width'?"),
        (["list", "metrics", "qqqq"], "qqqq: no such metric; 'noisy-world list metrics' names them"),
        (["describe", "genrate"], "genrate: nothing has this name; did you mean 'generate'?"),
    ],
)
def test_what_there_is_not(words, said, capsys):
    assert command.main(words) == 1
    assert capsys.readouterr().err == f"noisy-world {words[0]}: {said}\n"


def test_a_part_is_of_a_preset(capsys):
    with pytest.raises(SystemExit):
        command.main(["list", "keys", "--scenes", "a"])
    assert "--scenes=a is for scenes, settings, sequences" in capsys.readouterr().err
