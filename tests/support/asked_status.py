# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world status`, asked in this process."""

import json

from noisy_world.cli import command


def status(capsys, *arguments):
    capsys.readouterr()
    code = command.main(["status", *map(str, arguments)])
    return code, capsys.readouterr()


def as_json(capsys, *arguments):
    code, said = status(capsys, *arguments, "--json")
    return code, json.loads(said.out)
