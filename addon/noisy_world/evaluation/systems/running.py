# SPDX-License-Identifier: GPL-3.0-or-later
"""Running a system on a sequence: whatever the system does becomes a record, in a folder of the same few files."""

import csv
import json
import os
import signal
import threading
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

from ...core.datasets.storage import Mover, storage_errors, write_atomic
from ...core.errors import InputError, InterruptedRunError
from ...core.geometry import Intrinsics
from ...core.regular_files import read_text
from ..outcome import Outcome, RunRecord
from .checking import command_values, prepared, system_versions
from .definition import STUDY_NAMES, System, filled
from .estimate_file import ESTIMATE, KEYFRAMES, estimate_text
from .index import GivenSequence, given_sequence
from .leavings import check_output, found_output, remove_tree, restore_folder, sentence
from .normalising import Normalised, normalised
from .watching import CommandOutcome, watched

RUN = "run.json"
LOG = "log.txt"
FRAMES = "frames.csv"
MAP = "map.ply"
STATES = ("tracked", "lost", "not_initialised", "relocalised", "skipped")

WORK = ".work"  # of a run's folder: what the system writes and is given, until the run has ended
GRACE_S = 5.0  # chosen: a container takes seconds to stop


def run_system(
    system: System,
    sequence: Path,
    out: Path,
    *,
    stop: threading.Event | None = None,
    camera: Intrinsics | None = None,
    names: Mapping[str, str] | None = None,
    maps: bool = False,
    keep: bool = False,
) -> RunRecord:
    """Run a system on a sequence of any layout, and write into a folder how that ended and what it estimated.

    The folder then holds log.txt; estimate.txt, in TUM's format, unless there is no estimate; keyframes.txt, frames.csv
    and, if maps are asked for, map.ply where the system writes them; and run.json, which is written last. camera: its
    intrinsics, where no file says them. names: of the run in a study, for a command that names {scene}, {setting},
    {seed} or {repeat}. keep: what else the system wrote stays, in the folder .work/out.

    Raises InputError where the sequence cannot be read or the system cannot be run here, StorageError, and
    InterruptedRunError where `stop` was set; then there is no run.json.
    """
    system_versions(system)  # so that one which cannot be run is told before anything is written
    given = given_sequence(sequence, system.reads.modalities, camera, links=system.isolate != "none")
    out = out.resolve()
    work = _emptied(out)
    command = _command(system, given, work, names or {}, maps=maps)
    command, variables = prepared(system, command, work)
    limits, limit_s = system.limits, system.time_limit.of(len(given))
    writes = [work / "out", work / "tmp"]
    ended = watched(command, variables, writes, out / LOG, limits, limit_s=limit_s, grace_s=GRACE_S, stop=stop)
    with storage_errors(out):
        restore_folder(out, (work.name, LOG))
        lost = not (out / LOG).is_file()
        if lost:
            (out / LOG).write_text("")
    if stop is not None and stop.is_set():
        raise InterruptedRunError(f"{system.name} was stopped; its run will be made anew")
    record = _record(system, given, ended, out, work / "out", maps=maps)
    if lost:
        record = replace(record, detail=_sentences(record.detail, f"it removed its {LOG}"))
    if not remove_tree(work / "given" if keep else work):
        record = replace(record, detail=_sentences(record.detail, "what it wrote cannot be removed"))
    text = json.dumps(asdict(record), indent=1, sort_keys=True, allow_nan=False) + "\n"
    write_atomic(out / RUN, text.encode(), out)
    return record


def _emptied(out: Path) -> Path:
    """Remove what an earlier run left; return a new folder, with out, tmp and given, for what a run works with."""
    work = out / WORK
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
        for number in range(1, 1000):
            if remove_tree(work):
                break
            work = out / f"{WORK}-{number}"  # what a system left cannot be removed
        for name in ("out", "tmp", "given"):
            (work / name).mkdir(parents=True)
        for name in (RUN, ESTIMATE, KEYFRAMES, FRAMES, MAP):
            remove_tree(out / name)
    return work


def _command(system: System, given: GivenSequence, work: Path, names: Mapping[str, str], *, maps: bool) -> list[str]:
    """Return the command, after what it reads is written. Raises InputError where it names what only a study knows."""
    words = system.command + (system.map_arguments if maps else ())
    named = " ".join(words)
    unknown = next((name for name in STUDY_NAMES if f"{{{name}}}" in named and name not in names), None)
    if unknown is not None:
        remedy = "run it in a study: noisy-world evaluate"
        raise InputError(system.file, f"names {{{unknown}}}, which only a study knows", where="command", remedy=remedy)
    folder = work / "given" / "setting" / "sequence"
    frames = work / "given" / "frames.json"
    with storage_errors(folder):
        folder.mkdir(parents=True)
    if any("{frames}" in word for word in words):
        given.write_index(frames, work / "given" / "images")
    if any("{sequence}" in word for word in words):
        given.write_sequence(folder, system.reads.layouts)
    values = {"frames": frames.resolve(), "sequence": folder.resolve(), "out": (work / "out").resolve()}
    return filled(words, {**command_values(system), **names, **values})


def _record(
    system: System, given: GivenSequence, ended: CommandOutcome, out: Path, written: Path, *, maps: bool
) -> RunRecord:
    """Write what the system estimated; return how the run ended."""
    outcome, detail = _how_it_ended(ended, system.time_limit.of(len(given)))
    if outcome is Outcome.FINISHED:
        found = _estimated(system, given, written)
        outcome, detail = found.outcome, found.detail
        if outcome is Outcome.FINISHED:
            _write_estimate(out / ESTIMATE, found)
        detail = _sentences(detail, *_take_files(system, given, written, out, maps=maps))
    return RunRecord(
        system=system.name,
        outcome=outcome,
        detail=sentence(detail),
        frames=len(given),
        seconds=round(ended.seconds, 3),
        processor_s=_rounded(ended.processor_s),
        peak_memory_bytes=ended.peak_memory_bytes,
        exit_status=ended.status,
        versions=system_versions(system),
        isolated="" if system.isolate == "none" else system.isolate,
    )


def _how_it_ended(run: CommandOutcome, limit_s: float) -> tuple[Outcome, str]:
    if run.ended == "limit":
        return Outcome.TIMED_OUT, f"was stopped after {limit_s:g} s; {LOG} holds what it said"
    if run.ended == "over":
        return Outcome.OVER_LIMIT, run.problem
    if run.status is None:
        return Outcome.CRASHED, run.problem
    if run.status == 0:
        return Outcome.FINISHED, ""
    ended = f"ended with status {run.status}" if run.status > 0 else f"was ended by {_signal_name(-run.status)}"
    return Outcome.CRASHED, f"{ended}; {LOG} holds what it said"


def _estimated(system: System, given: GivenSequence, written: Path, pattern: str = "") -> Normalised:
    """Read an estimate, or that of keyframes by a pattern."""
    names = given.stored.rgb_files
    return normalised(
        written, system.writes, given.stamps_s, pattern, colour=names, largest_bytes=system.limits.estimate_bytes
    )


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _take_files(system: System, given: GivenSequence, written: Path, out: Path, *, maps: bool) -> list[str]:
    """Take over what else of the contract a system wrote; return sentences on what is wrong in it."""
    problems = []
    limits = system.limits
    if system.writes.keyframes and found_output(written, system.writes.keyframes) is not None:
        keyframes = _estimated(system, given, written, system.writes.keyframes)
        if keyframes.outcome is Outcome.FINISHED:
            _write_estimate(out / KEYFRAMES, keyframes)
        else:
            problems.append(f"its keyframes are not used: {keyframes.detail}")
    if os.path.lexists(written / FRAMES):
        problem = _problem(written / FRAMES, written, limits.estimate_bytes, "limits.estimate_mb")
        if problem := problem or _states_problem(written / FRAMES, len(given)):
            problems.append(f"its {FRAMES} is not used: {problem}")
        else:
            Mover(out).move((written / FRAMES).resolve(), out / FRAMES)
    if maps and os.path.lexists(written / MAP):
        if problem := _problem(written / MAP, written, limits.map_bytes, "limits.map_mb"):
            problems.append(f"its {MAP} is not used: {problem}")
        else:
            Mover(out).move((written / MAP).resolve(), out / MAP)
    return problems


def _problem(path: Path, folder: Path, largest_bytes: int, key: str) -> str:
    """Return why a file that a system left is not to be read, "" where it is."""
    if path.is_dir():
        return "is a folder"
    try:
        check_output(path, folder, largest_bytes, key)
    except InputError as error:
        return error.problem
    return ""


def _states_problem(path: Path, frames: int) -> str:
    """Return what is wrong in a list of the frames' states; "" where nothing is."""
    try:
        rows = list(csv.reader(read_text(path).splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        return f"it cannot be read: {error}"
    if not rows or rows[0][:3] != ["index", "stamp_s", "state"]:
        return "its header does not begin with index,stamp_s,state"
    for number, row in enumerate(rows[1:], 2):
        if len(row) < 3 or not _is_frame(row[0], frames) or row[2] not in STATES:
            return f"line {number} names no frame with a state of {', '.join(STATES)}"
    return ""


def _is_frame(text: str, frames: int) -> bool:
    """Tell whether a text is the number of a frame; Python refuses to convert thousands of digits."""
    return text.isascii() and text.isdecimal() and len(text.lstrip("0")) < 19 and int(text) < frames


def _write_estimate(path: Path, found: Normalised) -> None:
    write_atomic(path, estimate_text(found.estimate).encode(), path.parent)


def _sentences(*parts: str) -> str:
    return "; ".join(part for part in parts if part)


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)
