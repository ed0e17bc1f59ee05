# SPDX-License-Identifier: GPL-3.0-or-later
"""The options that subcommands share, and the words that repeat them."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path

from ..core.errors import StorageError
from .part import add_part_options, part_words
from .places import path, place
from .shipped import found_preset


def add_preset_options(parser: argparse.ArgumentParser) -> None:
    """Add what says which dataset is meant: the preset, changes of it, the frames, and the folder."""
    parser.add_argument(
        "preset",
        metavar="PRESET",
        nargs="?",
        type=path,
        help="the preset, a YAML file, or one of those that --list presets names",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=place,
        help="the dataset's folder (default: out/<name of the preset>), or an address such as s3://bucket/name, where "
        "it is packed; or a video such as walk.mp4, of the colour alone, to look at",
    )
    parser.add_argument(
        "--scratch",
        metavar="DIR",
        type=path,
        help="where shards are made that go to an address (default: the system's folder of temporary files)",
    )
    add_set_option(parser)
    add_part_options(parser)
    parser.add_argument(
        "--frames",
        metavar="A:B",
        type=frame_slice,
        help="only frames A to B-1 of each trajectory; they keep their numbers, and other frames that are there stay",
    )


def add_set_option(parser: argparse.ArgumentParser) -> None:
    """Add --set, which changes keys of the preset."""
    parser.add_argument(
        "--set",
        metavar="KEY.PATH=VALUE",
        action="append",
        default=[],
        nargs="+",
        dest="overrides",
        help="change a key of the preset, e.g. render.samples=4 or scenes.0.name=kitchen; may be repeated",
    )


def add_executor_options(
    parser: argparse.ArgumentParser, task: str, jobs: int | None, jobs_told: str, cpus: int
) -> None:
    """Add what names processes of this machine, or a Ray cluster. task: what each does one of. jobs, cpus: defaults."""
    parser.add_argument("--jobs", metavar="N", type=positive, default=jobs, help=jobs_told)
    parser.add_argument(
        "--ray",
        metavar="ADDRESS",
        nargs="?",
        const="auto",
        help=f"have each {task} done by a Ray cluster: the one that this machine belongs to (default), HOST:PORT, "
        "ray://HOST:PORT, or 'local' for one of this machine alone; it needs the extra cluster",
    )
    parser.add_argument(
        "--cpus",
        metavar="N",
        type=positive,
        default=cpus,
        help=f"with --ray: processors for each {task} (default: {cpus})",
    )
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)


def add_isolate_option(parser: argparse.ArgumentParser) -> None:
    """Add --isolate, which keeps systems apart."""
    parser.add_argument(
        "--isolate",
        choices=["none", "bubblewrap"],
        default="none",
        help="keep systems apart, so that each reaches its own folder alone; bubblewrap has to be installed",
    )


def add_progress_option(parser: argparse.ArgumentParser) -> None:
    """Add what says who hears how a run goes on."""
    parser.add_argument(
        "--progress",
        choices=["text", "json"],
        default="text",
        help="how a run reports its progress: text on standard error for people (default), or for programs lines of "
        "JSON on standard output, each after '@noisy-world '",
    )


def settle_overrides(parser: argparse.ArgumentParser, options: argparse.Namespace, subject: str) -> None:
    """Put the overrides into one list; --set takes every word after it, so the last may be the subject, a path."""
    options.overrides = [text for group in options.overrides for text in group]
    if getattr(options, subject) is None and options.overrides and "=" not in options.overrides[-1]:
        try:
            setattr(options, subject, path(options.overrides.pop()))
        except argparse.ArgumentTypeError as error:
            parser.error(str(error))


def settled(
    parser: argparse.ArgumentParser,
    options: argparse.Namespace,
    *,
    known: bool = False,
) -> argparse.Namespace:
    """Return the options with the overrides in one list and the preset's file found.

    known: whether no preset is needed. Exits with a usage line where one is needed and none is named.
    """
    settle_overrides(parser, options, "preset")
    if options.preset is None and getattr(options, "ray", None) not in (None, "auto"):
        options.preset, options.ray = path(options.ray), "auto"  # --ray PRESET: the word after it is the preset
    if options.preset is None and not known:
        parser.error("name a preset, presets/demo.yaml for instance")
    if options.preset is not None:
        options.preset = found_preset(options.preset)
    return options


def frame_slice(text: str) -> slice:
    """Parse A:B."""
    start, colon, stop = text.partition(":")
    if not colon or not all(part == "" or part.isdecimal() for part in (start, stop)):
        raise argparse.ArgumentTypeError(f"{text!r} has to be A:B, two frame numbers of which either may be left out")
    return slice(int(start) if start else None, int(stop) if stop else None)


def positive(text: str) -> int:
    """Parse a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} has to be a whole number from 1 up")
    return int(text)


def number(text: str, what: str, holds: Callable[[float], bool]) -> float:
    """Parse a finite number. what: "a number, 0 or more"; holds: tells whether it is."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and holds(value)):
        raise argparse.ArgumentTypeError(f"{text!r} has to be {what}")
    return value


def out_folder(options: argparse.Namespace) -> Path:
    """Return the dataset's folder. Raises StorageError where it is an address, for what works in folders only."""
    if isinstance(options.out, str):
        raise StorageError("is an address, and this needs a folder", file=options.out, remedy="name one with --out")
    return options.out if options.out is not None else Path("out") / options.preset.stem


def out_address(options: argparse.Namespace) -> str | None:
    """Return the address of the dataset; None where it is a folder."""
    return options.out if isinstance(options.out, str) else None


def preset_words(options: argparse.Namespace, *, anywhere: bool = False) -> list[str]:
    """Return the words that name the same dataset again.

    anywhere: whether they are read in another folder, or on another machine that sees the same disks.
    """
    words = [_pasteable(options.preset, anywhere=anywhere)]
    words += ["--out", out_address(options) or _pasteable(out_folder(options), anywhere=anywhere)]
    if options.scratch is not None:
        words += ["--scratch", _pasteable(options.scratch, anywhere=anywhere)]
    if options.overrides:
        words += ["--set", *options.overrides]
    words += part_words(options, anywhere=anywhere)
    if options.frames is not None:
        words += [
            "--frames",
            f"{options.frames.start or 0}:{'' if options.frames.stop is None else options.frames.stop}",
        ]
    return words


def _pasteable(path: Path, *, anywhere: bool) -> str:
    return pasteable_path(path.resolve() if anywhere else path)


def pasteable_path(path: Path) -> str:
    """Return a path as text that is read as this path again: one that begins with ~ is not a home folder here."""
    return f"./{path}" if str(path).startswith("~") else str(path)
