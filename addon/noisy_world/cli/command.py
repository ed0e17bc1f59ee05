# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed command `noisy-world`, also `python -m noisy_world`: a subcommand's name, then its own arguments.

A subcommand is a module of this package with `main(arguments, entry)`, which returns the exit status, and an entry in
SUBCOMMANDS. It is imported only when it is used.
"""

import importlib
import sys
from dataclasses import dataclass

from .entry import INTERRUPTED, Entry

COMMAND = "noisy-world"


@dataclass(frozen=True)
class Subcommand:
    """A subcommand: its module, and its description in `noisy-world --help`."""

    module: str
    meaning: str


SUBCOMMANDS = {
    "generate": Subcommand("generate", "make the RGB-D dataset that a preset describes"),
    "plan": Subcommand("plan_command", "print what a preset comes to, or the commands that make it in shards"),
    "shard": Subcommand("shard_command", "make one shard of a dataset, on any machine that sees its folder"),
    "merge": Subcommand("merge_command", "merge the shards of a dataset, and complete it"),
    "status": Subcommand("status", "say how far a dataset has come, and what of it is missing or damaged"),
    "list": Subcommand("list_command", "list what a preset may say and what is shipped, or what a preset holds"),
    "recipe": Subcommand("recipe_command", "write what makes a dataset, and the digests of its files"),
    "verify": Subcommand("verify_command", "hash a dataset's files and compare them with a recipe"),
    "materialise": Subcommand("materialise", "make a recipe's dataset again, or a part of it, and verify it"),
    "evaluate": Subcommand(
        "evaluate_command", "run SLAM systems on the sequences of a preset or a dataset, and score them"
    ),
    "track": Subcommand("track_command", "follow the camera through a dataset with rgbd_odometry"),
    "clean": Subcommand("clean_command", "render the clean frames that noisy_world.open makes a recipe's frames of"),
    "report": Subcommand("report_command", "write the report of a study anew"),
    "score": Subcommand("score_command", "compare an estimated trajectory with the true one"),
    "score-map": Subcommand("score_map_command", "compare the map of a SLAM system with the true scene"),
    "publish": Subcommand("publish_command", "pack a finished dataset as tars, in an object store or a folder"),
    "export": Subcommand("export_mesh", "write a mesh as PLY in Replica's layout"),
}


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit status. arguments: by default the process's own."""
    words = sys.argv[1:] if arguments is None else arguments
    if not words or words[0] in ("-h", "--help"):
        print(help_text())
        return 0 if words else 2
    if words[0] == "--version":
        from ..core.datasets.provenance import package_version

        print(f"{COMMAND} {package_version()}")
        return 0
    name, *rest = words
    if name not in SUBCOMMANDS:
        print(f"{COMMAND}: {name!r} is no subcommand; there are {', '.join(SUBCOMMANDS)}", file=sys.stderr)
        return 2
    module = importlib.import_module(f".{SUBCOMMANDS[name].module}", __package__)
    try:
        return module.main(rest, own_entry(name))
    except KeyboardInterrupt:
        return INTERRUPTED


def own_entry(subcommand: str) -> Entry:
    """Return how to start a subcommand again: by this Python, as its folder of commands may not be on the path."""
    return Entry(
        f"{COMMAND} {subcommand}",
        (sys.executable, "-m", "noisy_world", subcommand),
        remedy=f"install them with {sys.executable} -m pip install",
    )


def help_text() -> str:
    """Return what `noisy-world --help` prints."""
    width = max(len(name) for name in SUBCOMMANDS)
    lines = [f"usage: {COMMAND} SUBCOMMAND ...", "", "Clean 3D scenes in, noisy RGB-D worlds out.", "", "subcommands:"]
    lines += [f"  {name:<{width}}  {item.meaning}" for name, item in SUBCOMMANDS.items()]
    return "\n".join([*lines, "", f"'{COMMAND} SUBCOMMAND --help' tells more; '{COMMAND} --version' the version."])
