# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate`, `threshold`, `report`: systems run on sequences, and what came of it."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError, NoisyWorldError
from ..core.packages import need
from ..core.progress import counted
from ..core.schema import ConfigPath, read_yaml
from .arguments import (
    Parser,
    add_executor_options,
    add_isolate_option,
    add_part_options,
    add_progress_option,
    add_set_option,
    data_folder,
    folder,
    found_preset,
    no_such_preset,
    number,
    path,
    positive,
    settle_overrides,
    settled,
)
from .command import Command, as_given
from .entry import Entry, listener, work_on

if TYPE_CHECKING:
    from ..core.progress import Progress
    from ..evaluate.study import StudyOrder
    from ..evaluate.thresholds import Planned, SearchResult, Trial, Trials
    from ..preset.keys import Preset


def _report(options: argparse.Namespace, _: Entry) -> int:
    """Write the tables of runs and sequences from the folders' files, and the report."""
    from ..evaluate.study_results import STUDY, ResultsFolder, is_record
    from ..evaluate.study_tables import write_tables
    from .study_workers import tell_report

    if options.out is not None:
        return _join(options)
    (folder,) = options.results
    results = ResultsFolder(folder)
    if (folder / STUDY).is_file() and not is_record(results):
        try:
            write_tables(results)
        finally:
            results.tidy()
    if options.tables:
        print(f"wrote {results.tables}")
    else:
        tell_report(folder, options.against)
    return 0


def _join(options: argparse.Namespace) -> int:
    """Write the record of a study from the folders of its pieces, and its report."""
    from ..evaluate.study_results import ResultsFolder
    from ..evaluate.study_tables import joined, read_record, write_record
    from .study_workers import tell_report

    pieces = [ResultsFolder(folder) for folder in options.results]
    out = ResultsFolder(options.out)
    try:
        record = joined([(piece, read_record(piece)) for piece in pieces])
        write_record(record, out)
    finally:
        for results in (*pieces, out):
            results.tidy()
    runs, sequences = counted(len(record.runs), "run"), counted(len(record.sequences), "sequence")
    print(f"{runs} on {sequences}, of {counted(len(pieces), 'piece')}")
    if options.tables:
        print(f"wrote {out.folder / 'study.json'} and {out.tables}")
    else:
        tell_report(out.folder, options.against)
    return 0


def _report_options(parser: Parser) -> None:
    parser.option(
        "results RESULTS",
        "the folder that 'noisy-world evaluate' wrote; with --out, those of a study's pieces, or their records",
        type=folder,
        nargs="+",
    )
    parser.option(
        "--out DIR",
        "the folder of the record of all of it: study.json and the tables of runs and sequences; the report too",
        type=folder,
    )
    against = "the folder of a study of before: say which findings change, with intervals"
    parser.option("--against DIR", against, type=folder)
    parser.flag("--tables", "end with the tables of runs and sequences")


def _settle_report(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if len(options.results) > 1 and options.out is None:
        remedy = "name it with --out; two studies are put side by side with --against"
        parser.error(f"several folders are put together in another one: {remedy}")
    if options.tables and options.against is not None:
        parser.error("--against is of the report, which --tables leaves out")
    return options


REPORT = Command(
    name="report",
    order=160,
    group="evaluate SLAM systems",
    help="write the report of a study anew",
    description="Write the report of a study into its folder of results, from what is there: report.html, one page "
    "that opens offline, report.md, figures/ and tables/ as CSV, Parquet (where pyarrow is installed) and LaTeX. "
    "docs/report.md says what each part of it means. With --out, put a study together that was run in pieces; with "
    "--against, say which findings differ from those of another study.",
    options=_report_options,
    settle=_settle_report,
    run=_report,
    needs=("numpy", "yaml"),
    stopped="what was written before stays",
)


# --- `evaluate` ---


STUDY_CONTINUES = "what has ended stays, and the same command continues from there"


def _evaluate_options(parser: Parser) -> None:
    parser.option("subject PRESET_OR_DATASET", "a preset, or a folder of sequences", nargs="?", type=path)
    parser.option(
        "--systems NAMES",
        "the systems, with commas between: names of those that are shipped, or YAML files of your own",
        action="append",
        default=[],
    )
    parser.option("--out DIR", "the folder of results (default: out/NAME-results)", type=folder)
    parser.option(
        "--seeds N,N",
        "seeds of what is random in the perturbations (default: the preset's); paths stay the same, and settings "
        "that no seed changes are evaluated with the first only",
        type=whole_numbers,
        default=(),
    )
    parser.option(
        "--repeats N",
        "runs on each sequence of a system that does not repeat itself (default: 3); of others one is enough",
        type=positive,
        default=3,
    )
    parser.option(
        "--protocol",
        "whose metrics come first and whose errors are drawn; both are calculated (default: strict)",
        choices=["strict", "paper"],
        default="strict",
    )
    add_set_option(parser)
    add_part_options(parser)
    parser.option(
        "--rest-of DIR", "do what the record of this study in DIR lacks; 'report' puts both together", type=folder
    )
    parser.flag("--keep", "keep the sequences, in DIR/kept")
    parser.flag("--maps", "score maps too; where a system makes none, one is fused")
    add_isolate_option(parser)
    message = "sequences that are evaluated at once (default: the processors)"
    add_executor_options(parser, "sequence", None, message, cpus=1)
    parser.flag("--no-report", "end with the tables of runs and sequences; 'report' makes the rest later")
    parser.flag("--dry-run", "print what would be evaluated, and do nothing")
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
    from .study_workers import evaluate, ready_for_cases

    if options.worker:
        return work_on(ready_for_cases)
    return evaluate(order_of(options), options, entry)


def order_of(options: argparse.Namespace) -> "StudyOrder":
    """Return what is to be done, as plain values. Raises InputError for what is wrong in a preset."""
    from ..evaluate.study import StudyOrder
    from ..preset.keys import read_preset
    from ..preset.names import chosen_part

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
    given = {"--set": options.overrides, "--seeds": options.seeds, "--data": options.data, "--keep": options.keep}
    if found := [name for name, value in given.items() if value]:
        raise InputError(options.subject, f"is a folder of sequences, and {found[0]} goes with a preset")


def _found_system(name: str) -> str:
    """Return a system's name, or the whole path of the file that defines it: other processes read it from elsewhere."""
    return str(Path(name).resolve()) if name.endswith((".yaml", ".yml")) or "/" in name else name


EVALUATE = Command(
    name="evaluate",
    order=140,
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


# --- `threshold` ---


WIDTH, MOST = 0.15, 80


def _threshold_options(parser: Parser) -> None:
    parser.option("preset PRESET", "the preset whose scenes are used", nargs="?", type=path)
    parser.option(
        "--system NAMES",
        "the system: the name of one that is shipped, or a YAML file of your own; several with commas between",
        required=True,
    )
    parser.option("--perturbation NAME", "the perturbation", required=True)
    parser.option(
        "--parameter NAME",
        "its number that is searched (default: its severity, from 1 to 5 and between; or its only number)",
    )
    table = "where severities set it: a factor of 4 beyond that of severity"
    parser.option("--from VALUE", f"the mildest value (default, {table} 1)", dest="mild", type=float)
    parser.option("--to VALUE", f"the worst (default, {table} 5)", dest="worst", type=float)
    parser.option(
        "--with KEY=VALUE",
        "another key of the perturbation, translation_m=0 for instance; may be repeated",
        action="append",
        default=[],
        dest="given",
    )
    parser.option(
        "--success METRIC",
        "what counts as a success: a metric that is 0 or 1 (default: success_10cm, an ATE below 10 cm with 80 %% "
        "of the frames tracked)",
        default="success_10cm",
    )
    parser.option(
        "--width SHARE",
        f"how wide the interval may be, as a share of the way from the mildest to the worst (default: {WIDTH})",
        type=_share,
        default=WIDTH,
    )
    parser.option("--most N", f"the search ends after so many runs (default: {MOST})", type=positive, default=MOST)
    parser.option(
        "--out DIR",
        "the folder of thresholds, in which each search has one of its own (default: out/NAME-thresholds)",
        type=folder,
    )
    add_set_option(parser)
    add_part_options(parser, ("scenes",))  # the preset's settings are not used
    add_isolate_option(parser)
    add_progress_option(parser)


def _share(text: str) -> float:
    return number(text, "a number between 0 and 1, 0.15 for instance", lambda value: 0.0 < value < 1.0)


def _find_thresholds(options: argparse.Namespace, entry: Entry) -> int:
    """Search for each system, write the thresholds of the folder, and print what was found."""
    from ..core.atomic_files import FolderLock
    from ..evaluate.study_results import ResultsFolder
    from ..evaluate.study_sequences import PresetOrigin
    from ..evaluate.system_runs import check_system
    from ..evaluate.systems import find_systems, isolating
    from ..evaluate.thresholds import Trials, axis_of, check_success, preset_of, write_thresholds
    from ..perturbations import registry
    from ..perturbations.parsing import known_perturbation
    from .generate import need_blender, need_packages

    need(("matplotlib",), "evaluate")
    kind = known_perturbation(options.perturbation, ConfigPath("--perturbation"), registry())
    check_success(options.success)
    axis = axis_of(kind, options.parameter, options.mild, options.worst)
    preset = preset_of(_preset(options), axis, _given(options.given, axis.parameter))
    systems = isolating(find_systems(options.system.split(","), "--system"), options.isolate)
    for system in systems:
        check_system(system)
    out = Path("out") / f"{options.preset.resolve().stem}-thresholds" if options.out is None else options.out
    results = ResultsFolder(out.resolve() / axis.name)
    progress, stop = listener(options.progress)
    origin = PresetOrigin(preset, (), results, stop=stop)
    need_packages(origin.whole, argparse.Namespace(out=None, ray=None), entry)
    need_blender(origin.whole, entry)
    lock = FolderLock(results.work / "lock")
    scenes = {scene.name: scene.frame_count for scene in origin.whole.scenes}
    try:
        for system in systems:
            found = _search(Trials(origin, results, system, axis, options.success, stop), scenes, options, progress)
            print(f"{system.name}, {axis.name}: {found.text()}", flush=True)
        for scene in scenes:
            origin.finished(scene)
    finally:
        results.tidy(alone=True)
        lock.release()
    for file in write_thresholds(out):
        print(f"wrote {file}")
    return 0


def _search(
    trials: "Trials", scenes: dict[str, int], options: argparse.Namespace, progress: "Progress"
) -> "SearchResult":
    """Search with one system; what is made is written after each trial. scenes: how many frames each has."""
    from ..evaluate.thresholds import SearchFile, scene_of, search

    file = SearchFile(trials.results, trials.system.name)
    identity = trials.identity
    before = file.trials(identity)
    made = list(before)

    def carry_out(planned: "Planned") -> "Trial":
        trial = trials.make(planned, progress)
        made.append(trial)
        file.write(identity, made)
        progress.note(_line(trials.axis.text(trial.value), trial))
        progress.advance(scenes[trial.scene])
        return trial

    names, seed = list(scenes), trials.origin.preset.spec.seed
    frames = [scenes[scene_of(number, names, seed)] for number in range(options.most)]
    label = f"searching with {trials.system.name}, at most {options.most} runs"
    progress.start(label, sum(frames), sum(frames[: len(before)]))
    try:
        found = search(trials.axis, names, seed, before, carry_out, width=options.width, most=options.most)
    finally:
        progress.finish()
    file.write(identity, made, found)
    return found


def _line(value: str, trial: "Trial") -> str:
    error = "no error" if trial.ate_m is None else f"ATE {1000 * trial.ate_m:.1f} mm"
    ended_ = "success" if trial.succeeded else "no success"
    return f"run {trial.number + 1}, {trial.scene}, {value}: {ended_} ({error}, {trial.tracked_share:.0%} tracked)"


def _preset(options: argparse.Namespace) -> "Preset":
    """Return the preset. Raises InputError where it is not there or wrong."""
    from ..preset.keys import read_preset

    if not options.preset.exists():
        raise no_such_preset(options.preset)
    return read_preset(options.preset, options.overrides, data=data_folder(options), scenes=options.scenes)


def _given(texts: list[str], searched: str) -> dict[str, Any]:
    """Return the keys that --with gives. Raises NoisyWorldError."""
    found: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise NoisyWorldError(f"--with {text}: has to be KEY=VALUE, translation_m=0 for instance")
        if name == searched:
            raise NoisyWorldError(f"--with {text}: {name} is what is searched", remedy="leave it out")
        found[name] = read_yaml(value, "--with", name)
    return found


THRESHOLD = Command(
    name="threshold",
    order=150,
    group="evaluate SLAM systems",
    help="search for the value of a perturbation at which a system's success falls to one half",
    description="Search for the value of a perturbation at which a system's success falls to one half: run after "
    "run, each with the value that tells most, on a sequence of another scene of the preset, with noise of its "
    "own.",
    epilog="The same command again resumes a search that was stopped. The preset's settings are not used; "
    "docs/thresholds.md says how a threshold is found.",
    options=_threshold_options,
    settle=settled,
    run=_find_thresholds,
    stopped="the runs that have ended stay, and the same command goes on from there",
    again=as_given,
)

COMMAND = EVALUATE, THRESHOLD, REPORT
