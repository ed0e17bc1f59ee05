# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands that make a dataset in shards, as lines to paste into a shell, on any machine that sees its folder."""

import argparse
import shlex
import shutil
import sys
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from .arguments import preset_words

if TYPE_CHECKING:
    from ..core.planning.shards import Shard
    from ..executors.jobs import Task

COMMAND = "noisy-world"


def shard_words(options: argparse.Namespace, shard: "Shard | Task") -> list[str]:
    """Return the command that makes a shard. options: those that name the dataset."""
    return [*shard_beginning(options), shard.name]


def shard_beginning(options: argparse.Namespace, *more: str) -> list[str]:
    """Return the command that makes shards, whose names come last. more: options of it."""
    return [*_own_words(), "shard", *preset_words(options, anywhere=True), *more, "--shard"]


def merge_words(options: argparse.Namespace, count: int | None = None) -> list[str]:
    """Return the command that merges shards. count: into how many the plan was cut."""
    cut = [] if count is None else ["--shards", str(count)]
    return [*_own_words(), "merge", *preset_words(options, anywhere=True), *cut]


def shard_lines(options: argparse.Namespace, shards: Iterable["Shard"]) -> Iterator[str]:
    """Yield a line for each shard."""
    return (shlex.join(shard_words(options, shard)) for shard in shards)


def _own_words() -> list[str]:
    """Return the command, or how this Python starts it where the shell does not find it."""
    return [COMMAND] if shutil.which(COMMAND) else [sys.executable, "-m", "noisy_world"]
