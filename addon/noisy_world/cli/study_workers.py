# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate`, carried out: case after case, in this process or in several."""

import argparse
import shutil
import threading
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ..core.datasets.storage import FolderLock
from ..core.errors import InterruptedRunError, NoisyWorldError
from ..core.extras import need
from ..core.machine import available_threads
from ..core.planning.estimate import size_text
from ..core.progress import Progress
from ..evaluation.report import NEEDED as REPORT_NEEDS
from ..evaluation.study.cases import Case
from ..evaluation.study.identity import opened
from ..evaluation.study.made_origin import MadeOrigin
from ..evaluation.study.notes import EachOnce
from ..evaluation.study.order import StudyOrder
from ..evaluation.study.study import Study
from ..evaluation.study.summary import NEEDED as SUMMARY_NEEDS
from ..evaluation.study.tables import write_tables
from ..evaluation.systems.checking import check_system
from .entry import INTERRUPTED, Entry
from .generate import need_blender, need_packages
from .report_command import tell_report
from .running import listener, stop_on_signal
from .worker_pool import WorkerPool
from .workers import CommandReader, Parent

LARGEST_SHARE = 0.25  # of the free disk, that the clean frames of a scene may take; chosen


def evaluate(order: StudyOrder, options: argparse.Namespace, entry: Entry) -> int:
    """Evaluate what an order says, and print the outcome. Raises NoisyWorldError."""
    told, stop = listener(options.progress)
    progress = EachOnce(told)
    study = Study(order, stop=stop)
    if options.dry_run:
        _print_plan(study)
    for system in study.systems.values():
        check_system(system)
    _need_packages(study, options, entry)
    if options.dry_run:
        return 0
    if isinstance(study.origin, MadeOrigin):
        need_blender(study.origin.whole, entry)
    lock = FolderLock(study.results.work / "lock")
    try:
        opened(study.results, study.identity, seeds=_seeds(study), repeats=order.repeats)
        study = _fitting(study, progress, stop)
        _carry_out(study, options, entry, progress, stop)
        write_tables(study.results)
    finally:
        study.results.tidy(alone=True)
        lock.release()
    return _tell_outcome(study, report=not options.no_report)


def _need_packages(study: Study, options: argparse.Namespace, entry: Entry) -> None:
    """Raise MissingDependencyError where a package that is needed at any time of the study is missing."""
    need((*SUMMARY_NEEDS, *(() if options.no_report else REPORT_NEEDS)), "evaluate")
    if study.order.maps:
        need(["scipy", "embreex"], "evaluate", for_what="--maps")
    if isinstance(study.origin, MadeOrigin):
        need_packages(study.origin.whole, options, entry)


def _seeds(study: Study) -> list[int]:
    return list(dict.fromkeys(case.seed for case in study.origin.frames))


def _fitting(study: Study, progress: Progress, stop: threading.Event) -> Study:
    """Return the study, without kept clean frames where these would take too much of the disk."""
    if not isinstance(study.origin, MadeOrigin):
        return study
    needed, free = study.origin.clean_bytes, shutil.disk_usage(study.results.work).free
    if needed <= LARGEST_SHARE * free:
        return study
    told = f"the clean frames of a scene would take {size_text(needed)} of {size_text(free)} that are free"
    progress.note(f"{told}, so they are not kept: each setting is rendered anew")
    return Study(replace(study.order, keep_clean=False), stop=stop)


def _carry_out(
    study: Study, options: argparse.Namespace, entry: Entry, progress: Progress, stop: threading.Event
) -> None:
    """Do what is missing of a study."""
    cases = _Cases(study)
    if not cases.waiting:
        return
    total = sum(frames * len(study.runs_of(case)) for case, frames in study.origin.frames.items())
    left = sum(study.origin.frames[case] * len(study.missing_runs(case)) for case in cases.waiting)
    progress.start("evaluating", total, total - left)
    jobs = min(options.jobs or available_threads(), len(cases.waiting))
    try:
        if options.ray is not None:
            from .ray_cases import evaluate_on_ray

            evaluate_on_ray(study, list(cases.waiting), options, cases.done, progress, stop=stop)
        elif jobs == 1:
            while (case := cases.next()) is not None:
                study.carry_out(case, progress)
                cases.done(case)
        else:
            _in_processes(study.order, entry, cases, progress, stop, jobs=jobs)
    finally:
        progress.finish()


class _Cases:
    """The cases that are to be done, scene by scene, and what is let go of when a scene is."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self.waiting = deque(study.missing)
        self._left = Counter(case.scene for case in self.waiting)

    def next(self) -> Case | None:
        """Return the next case that nobody has taken."""
        return self.waiting.popleft() if self.waiting else None

    def done(self, case: Case) -> None:
        """Hear that a case is done."""
        self._left[case.scene] -= 1
        if not self._left[case.scene]:
            self._study.origin.finished(case.scene)


def _in_processes(
    order: StudyOrder, entry: Entry, cases: _Cases, progress: Progress, stop: threading.Event, *, jobs: int
) -> None:
    """Let several processes do the cases."""

    def next_for(_: int) -> str | None:
        case = cases.next()
        return None if case is None else case.name

    threads = str(max(1, available_threads() // jobs))
    variables = ("PYTHON_CPU_COUNT", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    crew = WorkerPool(entry.command(["--worker"]), order.text(), next_for, stop, dict.fromkeys(variables, threads))

    def hear(message: dict[str, Any]) -> None:
        heard(message, progress, crew.errors)

    crew.work(jobs, lambda name: cases.done(Case.parse(name)), hear)


def heard(message: dict[str, Any], progress: Progress, errors: list[str]) -> None:
    """Process a worker's message."""
    match message:
        case {"advance": count}:
            progress.advance(count)
        case {"note": text}:
            progress.note(text, message.get("subject", ""))
        case {"error": text}:
            errors.append(text)


def carry_out_orders() -> int:
    """Do the cases that the process names which started this one; return the exit status."""
    stop = stop_on_signal(None)
    told, parent = CommandReader(stop), Parent()
    if (line := told.next()) is None:
        return INTERRUPTED
    return _do_all(told.next, parent, lambda: Study(StudyOrder.parse(line), stop=stop), stop)


def _do_all(
    next_name: Callable[[], str | None], parent: Parent, make: Callable[[], Study], stop: threading.Event
) -> int:
    try:
        study = make()
        while (name := next_name()) is not None:
            study.carry_out(Case.parse(name), parent)
            parent.tell({"made": name})
    except InterruptedRunError:
        return INTERRUPTED
    except NoisyWorldError as error:
        parent.tell({"error": str(error)})
        return 1
    return INTERRUPTED if stop.is_set() else 0


def _print_plan(study: Study) -> None:
    """Print what would be evaluated."""
    cases = study.origin.frames
    runs = [run for case in cases for run in study.runs_of(case)]
    print(f"sequences  {len(cases)} of {sum(cases.values())} frames in all")
    for what in ("scene", "setting", "seed"):
        names = list(dict.fromkeys(str(getattr(case, what)) for case in cases))
        print(f"{what + 's':<10} {len(names)}: {', '.join(names)}")
    for name in study.systems:
        print(f"runs       {sum(run.system == name for run in runs)} of {name}")
    missing = sum(len(study.missing_runs(case)) for case in cases)
    print(f"missing    {missing} of {len(runs)} runs, in {study.results.folder}")


def _tell_outcome(study: Study, *, report: bool) -> int:
    """Print a short table, and where the results are; write the report."""
    from ..evaluation.study.summary import summary_text

    print(summary_text(study.results, study.order.protocol))
    if report:
        tell_report(study.results.folder)
    else:
        print(f"wrote {study.results.tables}")
    return 0
