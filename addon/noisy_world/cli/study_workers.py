# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate`, carried out: case after case, in this process or in several."""

import argparse
import shutil
import threading
from collections import Counter
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

from ..core.atomic_files import FolderLock
from ..core.errors import StorageError
from ..core.machine import available_threads
from ..core.packages import need
from ..core.progress import Progress, counted
from ..dataset.estimate import size_text
from ..evaluate.cases import Case
from ..evaluate.report import NEEDED as REPORT_NEEDS
from ..evaluate.study import Study, StudyOrder
from ..evaluate.study_results import STUDY, ResultsFolder, why_not, write_study_identity
from ..evaluate.study_sequences import PresetOrigin
from ..evaluate.study_tables import NEEDED as SUMMARY_NEEDS
from ..evaluate.study_tables import StudyRecord, read_record, write_tables
from ..evaluate.system_runs import check_system
from ..executors.jobs import Executor, InProcess, Job, Perform, Task, TaskOutcome, carry_out
from .entry import Entry, executor_of, listener
from .generate import need_blender, need_packages

LARGEST_SHARE = 0.25  # of the free disk, that the clean frames of a scene may take; chosen


def evaluate(order: StudyOrder, options: argparse.Namespace, entry: Entry) -> int:
    """Evaluate what an order says, and print the outcome. Raises NoisyWorldError."""
    progress, stop = listener(options.progress)
    record = None if options.rest_of is None else _record_of(options.rest_of)
    if record is not None:
        order = replace(order, elsewhere=tuple(run.name for run in record.runs))
    study = Study(order, stop=stop)
    if record is not None and (problem := why_not(dict(record.study), study.identity)):
        remedy = "name another with --rest-of"
        raise StorageError(f"is of another study: {problem}", file=options.rest_of, remedy=remedy)
    if options.dry_run:
        _print_plan(study)
    for system in study.systems.values():
        check_system(system)
    _need_packages(study, options, entry)
    if options.dry_run:
        return 0
    if not any(map(study.runs_of, study.origin.frames)):
        print(f"{options.rest_of} has all of these runs; nothing is left to do")
        return 0
    if isinstance(study.origin, PresetOrigin):
        need_blender(study.origin.whole, entry)
    lock = FolderLock(study.results.work / "lock")
    try:
        write_study_identity(study.results, study.identity, seeds=_seeds(study), repeats=order.repeats)
        study = _fitting(study, options, progress, stop)
        _carry_out(study, options, entry, progress, stop)
        write_tables(study.results)
    finally:
        study.results.tidy(alone=True)
        lock.release()
    return _tell_outcome(study, report=not options.no_report)


def _record_of(folder: Path) -> StudyRecord:
    results = ResultsFolder(folder)
    try:
        return read_record(results)
    finally:
        results.tidy()


def _need_packages(study: Study, options: argparse.Namespace, entry: Entry) -> None:
    """Raise MissingDependencyError where a package that is needed at any time of the study is missing."""
    need((*SUMMARY_NEEDS, *(() if options.no_report else REPORT_NEEDS)), "evaluate")
    if study.order.maps:
        need(["scipy", "embreex"], "evaluate", for_what="--maps")
    if isinstance(study.origin, PresetOrigin):
        need_packages(study.origin.whole, options, entry)


def _seeds(study: Study) -> list[int]:
    return list(dict.fromkeys(case.seed for case in study.origin.frames))


def _fitting(study: Study, options: argparse.Namespace, progress: Progress, stop: threading.Event) -> Study:
    """Return the study, without kept clean frames where these would take too much of the disk.

    Each process is at a scene of its own, so that many are there at once.
    """
    if not isinstance(study.origin, PresetOrigin):
        return study
    scenes = min(_jobs(study, options), len({case.scene for case in study.missing}))
    needed, free = scenes * study.origin.clean_bytes, shutil.disk_usage(study.results.work).free
    if needed <= LARGEST_SHARE * free:
        return study
    whose = "a scene" if scenes == 1 else f"{scenes} scenes at once"
    message = f"the clean frames of {whose} would take {size_text(needed)} of {size_text(free)} that are free"
    progress.note(f"{message}, so they are not kept: each setting is rendered anew")
    return Study(replace(study.order, keep_clean=False), stop=stop)


def _carry_out(
    study: Study, options: argparse.Namespace, entry: Entry, progress: Progress, stop: threading.Event
) -> None:
    """Do what is missing of a study."""
    if not study.missing:
        return
    frames = study.origin.frames
    total = sum(count * len(study.runs_of(case)) for case, count in frames.items())
    left = sum(frames[case] * len(study.missing_runs(case)) for case in study.missing)
    unfinished = Counter(case.scene for case in study.missing)

    def done(outcome: TaskOutcome) -> None:
        scene = Case.parse(outcome.name).scene
        unfinished[scene] -= 1
        if not unfinished[scene]:
            study.origin.finished(scene)

    progress.start("evaluating", total, total - left)
    try:
        with _executor(study, options, entry) as executor:
            carry_out(_job(study), executor, done, progress, stop)
    finally:
        progress.finish()


def _job(study: Study) -> Job:
    """Return the cases of a study that are to be done, scene by scene."""
    tasks = tuple(Task(case.name, case.scene, seconds=study.origin.frames[case]) for case in study.missing)
    return Job("sequences", "evaluated", "evaluate", study.order.text(), tasks, study.results.folder / STUDY)


def _executor(study: Study, options: argparse.Namespace, entry: Entry) -> AbstractContextManager[Executor]:
    """Return what does the cases."""
    jobs = _jobs(study, options)
    if options.ray is not None or jobs > 1:
        return executor_of(options, entry, jobs)
    return nullcontext(InProcess(lambda _, progress: nullcontext(_performing(study, progress))))


def _jobs(study: Study, options: argparse.Namespace) -> int:
    """Return how many processes of this machine do the cases, unless a cluster does."""
    return min(options.jobs or available_threads(), len(study.missing))


def ready_for_cases(order: str, progress: Progress, *, stop: threading.Event) -> AbstractContextManager[Perform]:
    """Be ready to do the cases of an order, given as its text; see `executors.jobs.Prepare`."""
    return nullcontext(_performing(Study(StudyOrder.parse(order), stop=stop), progress))


def _performing(study: Study, progress: Progress) -> Perform:
    return lambda name: study.carry_out(Case.parse(name), progress)


def _print_plan(study: Study) -> None:
    """Print what would be evaluated."""
    cases = study.origin.frames
    runs = [run for case in cases for run in study.runs_of(case)]
    print(f"sequences  {len(cases)} of {counted(sum(cases.values()), 'frame')} in all")
    for what in ("scene", "setting", "seed"):
        names = list(dict.fromkeys(str(getattr(case, what)) for case in cases))
        print(f"{what + 's':<10} {len(names)}: {', '.join(names)}")
    for name in study.systems:
        print(f"runs       {sum(run.system == name for run in runs)} of {name}")
    missing = sum(len(study.missing_runs(case)) for case in cases)
    print(f"missing    {missing} of {counted(len(runs), 'run')}, in {study.results.folder}")


def _tell_outcome(study: Study, *, report: bool) -> int:
    """Print a short table, and where the results are; write the report."""
    from ..evaluate.study_tables import summary_text

    print(summary_text(study.results, study.order.protocol))
    if report:
        tell_report(study.results.folder)
    else:
        print(f"wrote {study.results.tables}")
    return 0


def tell_report(results: Path, before: Path | None = None) -> None:
    """Write the report of a folder of results, and print what it found, what it has to do without and where it is.

    before: the folder of a study beside whose findings its own are put.
    """
    from ..evaluate.report import write_report

    written = write_report(results, before)
    for line in written.findings:
        print(line)
    for line in written.missing:
        print(f"missing: {line}")
    print(f"wrote {results / 'report.html'}, and beside it report.md, figures/ and tables/")
