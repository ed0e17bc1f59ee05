# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate`: run SLAM systems on the sequences of a preset or a dataset, and score them."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .arguments import (
    add_executor_options,
    add_isolate_option,
    add_progress_option,
    add_set_option,
    positive,
    settle_overrides,
)
from .command import Command, as_given
from .entry import Entry
from .parser import Parser
from .part import add_part_options
from .places import folder, path
from .running import work_on
from .shipped import found_preset, no_such_preset

if TYPE_CHECKING:
    from ..evaluation.study.order import StudyOrder

STUDY_CONTINUES = "what has ended stays, and the same command continues from there"


def _evaluate_options(parser: Parser) -> None:
    parser.add_argument(
        "subject", metavar="PRESET_OR_DATASET", nargs="?", type=path, help="a preset, or a folder of sequences"
    )
    parser.add_argument(
        "--systems",
        metavar="NAMES",
        action="append",
        default=[],
        help="the systems, with commas between: names of those that are shipped, or YAML files of your own",
    )
    parser.add_argument("--out", metavar="DIR", type=folder, help="the folder of results (default: out/NAME-results)")
    parser.add_argument(
        "--seeds",
        metavar="N,N",
        type=whole_numbers,
        default=(),
        help="seeds of what is random in the perturbations (default: the preset's); paths stay the same, and settings "
        "that no seed changes are evaluated with the first only",
    )
    parser.add_argument(
        "--repeats",
        metavar="N",
        type=positive,
        default=3,
        help="runs on each sequence of a system that does not repeat itself (default: 3); of others one is enough",
    )
    parser.add_argument(
        "--protocol",
        choices=["strict", "paper"],
        default="strict",
        help="whose metrics come first and whose errors are drawn; both are calculated (default: strict)",
    )
    add_set_option(parser)
    add_part_options(parser)
    parser.add_argument(
        "--rest-of",
        metavar="DIR",
        type=folder,
        help="do what the record of this study in DIR lacks; 'report' puts both together",
    )
    parser.add_argument("--keep", action="store_true", help="keep the sequences, in DIR/kept")
    parser.add_argument("--maps", action="store_true", help="score maps too; where a system makes none, one is fused")
    add_isolate_option(parser)
    message = "sequences that are evaluated at once (default: the processors)"
    add_executor_options(parser, "sequence", None, message, cpus=1)
    parser.add_argument(
        "--no-report",
        action="store_true",
        help="end with the tables of runs and sequences; 'report' makes the rest later",
    )
    parser.add_argument("--dry-run", action="store_true", help="print what would be evaluated, and do nothing")
    add_progress_option(parser)


def _settle_study(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    settle_overrides(parser, options, "subject")
    if not options.worker:
        if options.subject is None:
            parser.error("name a preset, presets/study.yaml for instance, or a folder of sequences")
        options.systems = [name.strip() for text in options.systems for name in text.split(",") if name.strip()]
        if not options.systems:
            parser.error("name the systems with --systems, rgbd_odometry for instance")
    return options


def whole_numbers(text: str) -> tuple[int, ...]:
    """Parse whole numbers with commas between, each once."""
    parts = text.split(",")
    if not all(part.strip().isdecimal() and int(part) < 2**63 for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} has to be whole numbers with commas between, 1,2,3 for instance")
    return tuple(dict.fromkeys(map(int, parts)))


def _evaluate(options: argparse.Namespace, entry: Entry) -> int:
    """Carry out the options."""
    from .study_tasks import evaluate, ready_for_cases

    if options.worker:
        return work_on(ready_for_cases)
    return evaluate(order_of(options), options, entry)


def order_of(options: argparse.Namespace) -> "StudyOrder":
    """Return what is to be done, as plain values. Raises InputError for what is wrong in a preset."""
    from ..core.presets.preset import read_preset
    from ..core.presets.selection import chosen_part
    from ..evaluation.study.order import StudyOrder
    from .part import data_folder

    subject: Path = options.subject
    document, part = None, {}
    if subject.is_dir():
        _refuse_for_folder(options)
        part = chosen_part(options.scenes, options.settings)
    else:
        subject = found_preset(subject)
        if not subject.exists():
            raise no_such_preset(subject)
        data = data_folder(options)
        preset = read_preset(subject, options.overrides, data=data, scenes=options.scenes, settings=options.settings)
        document = preset.document
    out = Path("out") / f"{subject.resolve().stem}-results" if options.out is None else options.out
    return StudyOrder(
        subject=str(subject.resolve()),
        document=document,
        out=str(out.resolve()),
        systems=tuple(_found_system(name) for name in options.systems),
        seeds=options.seeds,
        repeats=options.repeats,
        protocol=options.protocol,
        scenes=tuple(part.get("scenes", ())),
        settings=tuple(part.get("settings", ())),
        keep=options.keep,
        maps=options.maps,
        isolate=options.isolate,
    )


def _refuse_for_folder(options: argparse.Namespace) -> None:
    """Raise InputError for options that go with a preset alone."""
    from ..core.errors import InputError

    given = {"--set": options.overrides, "--seeds": options.seeds, "--data": options.data, "--keep": options.keep}
    if found := [name for name, value in given.items() if value]:
        raise InputError(options.subject, f"is a folder of sequences, and {found[0]} goes with a preset")


def _found_system(name: str) -> str:
    """Return a system's name, or the whole path of the file that defines it: other processes read it from elsewhere."""
    return str(Path(name).resolve()) if name.endswith((".yaml", ".yml")) or "/" in name else name


EVALUATE = Command(
    name="evaluate",
    group="evaluate SLAM systems",
    help="run SLAM systems on the sequences of a preset or a dataset, and score them",
    description="Run SLAM systems on the sequences of a preset, each made when it is needed and removed after, or "
    "on those of a dataset or recording; score them, and report.",
    epilog="The same command again resumes a study that was stopped; more systems, scenes, settings, seeds and "
    "repeats can be added to it.",
    options=_evaluate_options,
    settle=_settle_study,
    run=_evaluate,
    stopped=STUDY_CONTINUES,
    again=as_given,
)
