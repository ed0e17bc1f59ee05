# SPDX-License-Identifier: GPL-3.0-or-later
"""The options that commands share: the preset, the part of it that is meant, places, and who does the work."""

import argparse
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from ..core.errors import InputError, NoisyWorldError, StorageError, nearest, one_line
from ..core.file_access import RENAME, is_utf8, with_home
from ..core.packages import shipped
from .entry import say

if TYPE_CHECKING:
    from ..core.errors import InputError
    from ..dataset.plan import Plan
    from ..dataset.recipe import Recipe
    from ..dataset.run import Destination
    from ..dataset.shards import Shard


class Parser(argparse.ArgumentParser):
    """An ArgumentParser whose complaints are one line each."""

    def option(self, words: str, meaning: str, **how: Any) -> None:
        """Add an option or, without dashes, an argument. words: its name, and what its value is called: --jobs N."""
        name, _, value = words.partition(" ")
        self.add_argument(name, help=meaning, **({"metavar": value} if value else {}), **how)

    def flag(self, name: str, meaning: str) -> None:
        """Add an option that is given or not."""
        self.add_argument(name, help=meaning, action="store_true")

    def error(self, message: str) -> NoReturn:
        """Print one line and end with exit status 2."""
        more = "" if message.endswith("?") else f"; '{self.prog} --help' tells more"
        self.exit(2, f"{self.prog}: error: {message}{more}\n")

    def parse_args(  # pyright: ignore[reportIncompatibleMethodOverride]  its overloads tell types of namespaces
        self, args: Iterable[str] | None = None, namespace: Any = None
    ) -> Any:
        """Parse the words; end with a line where one is not UTF-8, or has no place, with the option that is near it."""
        words = sys.argv[1:] if args is None else list(args)
        if odd := next((word for word in words if not is_utf8(word)), ""):
            self.error(f"{one_line(odd)} is not UTF-8; where it names a file, {RENAME}")
        options, others = self.parse_known_args(words, namespace)
        if others:
            self.error(self._no_place(others[0]))
        return options

    def _no_place(self, word: str) -> str:
        if not word.startswith("-"):
            return f"{word!r} is one word too many"
        name = word.partition("=")[0]
        known = {text.lstrip("-"): text for action in self._actions for text in _shown_options(action)}
        near = nearest(name.lstrip("-"), known)
        return f"unknown option {name}" + (f"; did you mean {known[near]}?" if near else "")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Raise ArgumentError for a value that is none of an option's choices, with the one that is near it."""
        if action.choices is None or value in action.choices:
            return
        known = [str(choice) for choice in action.choices]
        near = nearest(str(value), known)
        asked = f"did you mean {near!r}?" if near else f"choose from {', '.join(known)}"
        raise argparse.ArgumentError(action, f"{str(value)!r} is none of its values; {asked}")


def _shown_options(action: argparse.Action) -> Sequence[str]:
    """Return an option's names; none of one that --help does not show."""
    return () if action.help == argparse.SUPPRESS else action.option_strings


# --- places: a folder, or an address such as s3://bucket/name ---


def path(text: str) -> Path:
    """Parse a path, in which ~ and ~user are home folders."""
    try:
        return with_home(text)
    except LookupError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def place(text: str) -> Path | str:
    """Parse a folder, or an address, which stays a text: a path would lose a slash of it."""
    return text if "://" in text else path(text)


def out_path(text: str) -> Path:
    """Parse the file or folder to write, where an address cannot be taken."""
    if "://" in text:
        raise argparse.ArgumentTypeError(f"{text} is an address, and this is written on this machine; name a path")
    return path(text)


def folder(text: str) -> Path:
    """Parse a folder, where an address cannot be taken."""
    if "://" in text:
        raise argparse.ArgumentTypeError(f"{text} is an address, and a folder is needed; unpack its tars into one")
    return path(text)


# --- presets ---


ENDINGS = (".yaml", ".yml")


def shipped_presets() -> dict[str, Path]:
    """Return the shipped presets by their names in `--list presets`, such as presets/demo.yaml."""
    presets = shipped("presets")
    return {path.relative_to(presets.parent).as_posix(): path for path in sorted(presets.rglob("*.yaml"))}


def found_preset(path: Path) -> Path:
    """Return the preset's file: the one that is named or, where there is none, the shipped one of that name."""
    if path.exists() or (found := shipped_presets().get(path.as_posix())) is None:
        return path
    say(f"{path}: not in this folder; taking the one that comes with Noisy World, {found}")
    return found


def no_such_preset(path: Path) -> "InputError":
    """Return the error for a preset that is not there, with the one that is near it: in its folder, or shipped."""
    beside = sorted(path.parent.iterdir()) if path.parent.is_dir() else []
    known = {Path(name).name: name for name in shipped_presets()}
    known |= {item.name: str(item) for item in beside if item.suffix in ENDINGS}
    near = nearest(path.name, known)
    listed = "'noisy-world list presets' names those that are shipped"
    return InputError(path, "no such preset", remedy=f"did you mean {known[near]!r}?" if near else listed)


# --- where a preset's data lie, and which part of it is meant ---


EXAMPLES = {"scenes": "'room*,office0'", "settings": "'clean,fog*'"}


def add_part_options(parser: Parser, parts: "Sequence[str]" = tuple(EXAMPLES)) -> None:
    """Add --data, --scenes and --settings. parts: which of the latter two a subcommand knows."""
    parser.option(
        "--data DIR",
        "folder that the scenes' paths are relative to, and where Replica is looked for (default: the preset's)",
    )
    others = "; a dataset can grow by others" if "settings" in parts else ""
    for what in parts:
        parser.option(
            f"--{what} NAMES",
            f"only these {what}, {EXAMPLES[what]} for instance; may be repeated{others}",
            action="append",
            default=[],
        )


def planned(options: argparse.Namespace, shards: "Sequence[Shard]" = ()) -> "Plan":
    """Return the plan of the preset and the part of it that the options name: with --set and --frames too.

    shards: with some, the plan of their scenes alone.

    Raises InputError where there is no such preset, and for what is wrong in it or its files.
    """
    data = data_folder(options)
    if not options.preset.exists():
        raise no_such_preset(options.preset)
    from ..dataset.plan import make_plan
    from ..preset.keys import read_preset

    preset = read_preset(options.preset, options.overrides, data=data, scenes=options.scenes, settings=options.settings)
    return make_plan(preset, options.frames, {shard.scene for shard in shards})


def recipe_part(recipe: "Recipe", options: argparse.Namespace) -> "Plan":
    """Return the plan of the part of a recipe that the options name: with --frames too.

    Raises InputError where an input is missing or is not the one that the recipe was made from.
    """
    from ..dataset.remaking import plan_of

    return plan_of(recipe, data_folder(options), options.scenes, options.settings, options.frames)


def data_folder(options: argparse.Namespace) -> Path | None:
    """Return the folder that --data names, None without it."""
    try:
        return None if options.data is None else with_home(options.data)
    except LookupError as error:
        raise NoisyWorldError(f"--data: {error}") from error


def part_words(options: argparse.Namespace, *, anywhere: bool = False) -> list[str]:
    """Return the words of a command line that repeat --data, --scenes and --settings.

    anywhere: whether they are read in another folder, or on another machine that sees the same disks.
    """
    words: list[str] = []
    if options.data is not None:
        words.append(f"--data={with_home(options.data).resolve() if anywhere else options.data}")
    for what in ("scenes", "settings"):
        words += [f"--{what}={text}" for text in getattr(options, what)]
    return words


# --- options that subcommands share, and the words that repeat them ---


def add_preset_options(parser: Parser) -> None:
    """Add what says which dataset is meant: the preset, changes of it, the frames, and the folder."""
    parser.option(
        "preset PRESET", "the preset, a YAML file, or one of those that --list presets names", nargs="?", type=path
    )
    parser.option(
        "--out DIR",
        "the dataset's folder (default: out/<name of the preset>), or an address such as s3://bucket/name, where "
        "it is packed; or a video such as walk.mp4, of the colour alone, to look at",
        type=place,
    )
    parser.option(
        "--scratch DIR",
        "where shards are made that go to an address (default: the system's folder of temporary files)",
        type=path,
    )
    add_set_option(parser)
    add_part_options(parser)
    parser.option(
        "--frames A:B",
        "only frames A to B-1 of each trajectory; they keep their numbers, and other frames that are there stay",
        type=frame_slice,
    )


def add_set_option(parser: Parser) -> None:
    """Add --set, which changes keys of the preset."""
    parser.option(
        "--set KEY.PATH=VALUE",
        "change a key of the preset, e.g. render.samples=4 or scenes.0.name=kitchen; may be repeated",
        action="append",
        default=[],
        nargs="+",
        dest="overrides",
    )


def add_executor_options(parser: Parser, task: str, jobs: int | None, jobs_told: str, cpus: int) -> None:
    """Add what names processes of this machine, or a Ray cluster. task: what each does one of. jobs, cpus: defaults."""
    parser.option("--jobs N", jobs_told, type=positive, default=jobs)
    parser.option(
        "--ray ADDRESS",
        f"have each {task} done by a Ray cluster: the one that this machine belongs to (default), HOST:PORT, "
        "ray://HOST:PORT, or 'local' for one of this machine alone; it needs the extra cluster",
        nargs="?",
        const="auto",
    )
    parser.option("--cpus N", f"with --ray: processors for each {task} (default: {cpus})", type=positive, default=cpus)
    parser.flag("--worker", argparse.SUPPRESS)


def add_isolate_option(parser: Parser) -> None:
    """Add --isolate, which keeps systems apart."""
    parser.option(
        "--isolate",
        "keep systems apart, so that each reaches its own folder alone; bubblewrap has to be installed",
        choices=["none", "bubblewrap"],
        default="none",
    )


def add_progress_option(parser: Parser) -> None:
    """Add what says who hears how a run goes on."""
    parser.option(
        "--progress",
        "how a run reports its progress: text on standard error for people (default), or for programs lines of "
        "JSON on standard output, each after '@noisy-world '",
        choices=["text", "json"],
        default="text",
    )


def settle_overrides(parser: Parser, options: argparse.Namespace, subject: str) -> None:
    """Put the overrides into one list; --set takes every word after it, so the last may be the subject, a path."""
    options.overrides = [text for group in options.overrides for text in group]
    if getattr(options, subject) is None and options.overrides and "=" not in options.overrides[-1]:
        try:
            setattr(options, subject, path(options.overrides.pop()))
        except argparse.ArgumentTypeError as error:
            parser.error(str(error))


def settled(
    parser: Parser,
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


# --- where a command's dataset goes ---


def destination_of(
    plan: "Plan", options: argparse.Namespace, *, folder: Path | None = None, put_by_workers: bool = False
) -> "Destination":
    """Return where a plan's dataset goes. folder: where, if not where the options say.

    put_by_workers: whether workers on other machines put shards to an address themselves. Raises InputError where
    frames have no pose, which a packed dataset's table has for each, StorageError where an address is to be overwritten
    or has no meaning.
    """
    from ..dataset.run import Destination

    address = out_address(options)
    if folder is not None or address is None:
        return Destination(plan, folder or out_folder(options))
    from ..dataset.address_run import AddressDestination
    from ..dataset.store import open_store

    if vars(options).get("overwrite"):
        remedy = "choose another address with --out, or remove a shard's .json there"
        raise StorageError(f"--overwrite replaces datasets and shards in folders; {remedy}")
    for scene in plan.scenes:
        if not (scene.source.capabilities.any_pose or scene.path.known.all()):
            message = "frames without a pose cannot be at an address, whose table of frames has one for each"
            raise scene.place.error(message, "write the dataset into a folder")
    return AddressDestination(plan, open_store(address), options.scratch, put_by_workers=put_by_workers)
