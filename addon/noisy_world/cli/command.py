# SPDX-License-Identifier: GPL-3.0-or-later
"""The installed command `noisy-world`, also `python -m noisy_world`: a subcommand's name, then its own arguments.

A subcommand is a module of this package with `main(arguments, entry)`, which returns the exit status, and an entry in
GROUPS. It is imported only when it is used.
"""

import argparse
import importlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from ..core.near import did_you_mean
from .ending import exit_status
from .entry import Entry, say
from .parser import Parser

COMMAND = "noisy-world"


@dataclass(frozen=True)
class Subcommand:
    """A subcommand: its module, and its description in `noisy-world --help`."""

    module: str
    meaning: str


GROUPS = {
    "make a dataset": {
        "generate": Subcommand("generate", "make the RGB-D dataset that a preset describes"),
        "plan": Subcommand("plan_command", "print what a preset comes to, or the commands that make it in shards"),
        "shard": Subcommand("shard_command", "make one shard of a dataset, on any machine that sees its folder"),
        "merge": Subcommand("merge_command", "merge the shards of a dataset, and complete it"),
    },
    "look at what there is": {
        "list": Subcommand("list_command", "list what a preset may say and what is shipped, or what a preset holds"),
        "status": Subcommand("status", "say how far a dataset has come, and what of it is missing or damaged"),
        "view": Subcommand("view_command", "open a dataset's images, paths, IMU and perturbations in Rerun's viewer"),
        "video": Subcommand("video_command", "write a dataset's sequences as videos to look at, or as one sheet"),
    },
    "share a dataset, and make it again": {
        "publish": Subcommand("publish_command", "pack a finished dataset as tars, in an object store or a folder"),
        "recipe": Subcommand("recipe_command", "write what makes a dataset, and the digests of its files"),
        "verify": Subcommand("verify_command", "hash a dataset's files and compare them with a recipe"),
        "remake": Subcommand("remake", "make a recipe's dataset again, or a part of it, and verify it"),
        "render-clean": Subcommand(
            "render_clean", "render the clean frames that noisy_world.open makes a recipe's frames of"
        ),
    },
    "evaluate SLAM systems": {
        "evaluate": Subcommand(
            "evaluate_command", "run SLAM systems on the sequences of a preset or a dataset, and score them"
        ),
        "threshold": Subcommand(
            "threshold_command", "search for the value of a perturbation at which a system's success falls to one half"
        ),
        "report": Subcommand("report_command", "write the report of a study anew"),
        "run-odometry": Subcommand("run_odometry", "follow the camera through a dataset with rgbd_odometry"),
        "systems": Subcommand("systems_command", "list the systems and whether they can be run here; install one"),
        "score": Subcommand("score_command", "compare an estimated trajectory with the true one"),
        "score-map": Subcommand("score_map_command", "compare the map of a SLAM system with the true scene"),
    },
    "prepare and convert": {
        "simulate": Subcommand("simulate_command", "let a robot's body follow a scene's path, by physics: a path file"),
        "scan": Subcommand("scan_command", "spin a lidar along the paths of meshes: point clouds with times"),
        "bag": Subcommand("bag_command", "write a sequence of the layout euroc as a bag of ROS 2"),
        "export": Subcommand("export_mesh", "write a mesh as PLY in Replica's layout"),
    },
}
SUBCOMMANDS = {name: item for group in GROUPS.values() for name, item in group.items()}
# What people look for under another word, and under the names that there were before 0.1.0.
OTHER_WORDS = {
    "clean": "render-clean",
    "materialise": "remake",
    "materialize": "remake",
    "track": "run-odometry",
    "odometry": "run-odometry",
    "help": "--help",
    "version": "--version",
}


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit status. arguments: by default the process's own."""
    words = sys.argv[1:] if arguments is None else arguments
    return exit_status(lambda: _carry_out(words))


def _carry_out(words: Sequence[str]) -> int:
    if not words:
        print(help_text())
        return 2
    if words[0].startswith("-"):
        _parser().parse_args(words[:1])  # ends with --help and --version, and for what is neither
    name, *rest = words
    if name not in SUBCOMMANDS:
        meant = OTHER_WORDS.get(name.casefold())
        asked = did_you_mean(name, SUBCOMMANDS) if meant is None else f"did you mean {meant!r}?"
        say(f"{COMMAND}: {name!r} is no subcommand; {asked or 'there are ' + ', '.join(SUBCOMMANDS)}")
        return 2
    return importlib.import_module(f".{SUBCOMMANDS[name].module}", __package__).main(rest, own_entry(name))


def own_entry(subcommand: str) -> Entry:
    """Return how to start a subcommand again: by this Python, as its folder of commands may not be on the path."""
    return Entry(
        f"{COMMAND} {subcommand}",
        (sys.executable, "-m", "noisy_world", subcommand),
        remedy=f"install them with {sys.executable} -m pip install",
    )


def help_text() -> str:
    """Return what `noisy-world --help` prints."""
    return _parser().format_help().rstrip("\n")


class _PrintVersion(argparse.Action):
    """Print the version, which is looked up only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> NoReturn:
        from ..core.datasets.provenance import package_version

        print(f"{COMMAND} {package_version()}")
        parser.exit()


def _parser() -> Parser:
    """Return the parser of what stands before a subcommand, whose help tells the subcommands in their groups."""
    parser = Parser(
        prog=COMMAND,
        usage=f"{COMMAND} SUBCOMMAND ...",
        description="Clean 3D scenes in, noisy RGB-D worlds out.",
        epilog=_format_groups() + f"\n\n'{COMMAND} SUBCOMMAND --help' tells more.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_PrintVersion, nargs=0, help="print the version and end")
    return parser


def _format_groups() -> str:
    """Return the subcommands in their groups, each with its meaning."""
    width = max(map(len, SUBCOMMANDS))
    groups = (
        "\n".join([f"{title}:", *(f"  {name:<{width}}  {item.meaning}" for name, item in group.items())])
        for title, group in GROUPS.items()
    )
    return "\n\n".join(groups)
