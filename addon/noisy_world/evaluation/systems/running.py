# SPDX-License-Identifier: GPL-3.0-or-later
"""Running a system on a sequence: whatever the system does becomes a record, in a folder of the same few files."""

import contextlib
import csv
import json
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...core.datasets.storage import Mover, storage_errors, write_atomic
from ...core.errors import InputError, InterruptedRunError, NoisyWorldError
from ...core.geometry import Intrinsics
from ...core.regular_files import read_text
from ..outcome import Outcome, RunRecord
from .checking import command_values, system_versions, variables_of
from .definition import STUDY_NAMES, System, filled
from .estimate_file import ESTIMATE, KEYFRAMES, estimate_text
from .index import Given, given_sequence
from .normalising import Normalised, found_file, normalised

RUN = "run.json"
LOG = "log.txt"
FRAMES = "frames.csv"
MAP = "map.ply"
STATES = ("tracked", "lost", "not_initialised", "relocalised", "skipped")

GUARD = Path(__file__).with_name("guard.py")
WORK = ".work"  # of a run's folder: what the system writes and is given, until the run has ended
LOG_BYTES = 256 * 1024  # of the beginning, and of the end
GRACE_S = 5.0  # chosen: a container takes seconds to stop
POLL_S = 0.05


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
    versions = system_versions(system)
    given = given_sequence(sequence, system.reads.modalities, camera)
    work = out / WORK
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(work, ignore_errors=True)
        (work / "out").mkdir(parents=True)
        for name in (RUN, ESTIMATE, KEYFRAMES, FRAMES, MAP):
            (out / name).unlink(missing_ok=True)
    command = _command(system, given, work, names or {}, maps=maps)
    told = _guarded(command, system, given, out, stop)
    if stop is not None and stop.is_set():
        raise InterruptedRunError(f"{system.name} was stopped; its run will be made anew")
    record = _record(system, given, told, versions, out, maps=maps)
    with storage_errors(work):
        shutil.rmtree(work / "given")
        if not keep:
            shutil.rmtree(work)
    text = json.dumps(asdict(record), indent=1, sort_keys=True, allow_nan=False) + "\n"
    write_atomic(out / RUN, text.encode(), out)
    return record


def _command(system: System, given: Given, work: Path, names: Mapping[str, str], *, maps: bool) -> list[str]:
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
    given.write_index(frames)
    if any("{sequence}" in word for word in words):
        given.write_sequence(folder, system.reads.layouts)
    values = {"frames": frames.resolve(), "sequence": folder.resolve(), "out": (work / "out").resolve()}
    return filled(words, {**command_values(system), **names, **values})


def _guarded(
    command: list[str], system: System, given: Given, out: Path, stop: threading.Event | None
) -> dict[str, Any]:
    """Run a command in a process group of its own; return what its guard tells."""
    order = {
        "command": command,
        "folder": str((out / WORK / "out").resolve()),
        "log": str((out / LOG).resolve()),
        "log_bytes": LOG_BYTES,
        "limit_s": system.time_limit.of(len(given)),
        "grace_s": GRACE_S,
    }
    process = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-I", "-S", str(GUARD), json.dumps(order)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=variables_of(system),
        start_new_session=True,  # Ctrl-C is for us: the guard ends when its input does
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        while process.poll() is None:
            if stop is not None and stop.wait(POLL_S):
                break
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(POLL_S if stop is not None else None)
    finally:
        process.stdin.close()
        told = process.stdout.read()
        status = process.wait()
        process.stdout.close()
    if status != 0:
        raise NoisyWorldError(f"{out / LOG}: the process that watches over {system.name} ended with {status}")
    return json.loads(told)


def _record(
    system: System, given: Given, told: dict[str, Any], versions: dict[str, str], out: Path, *, maps: bool
) -> RunRecord:
    """Write what the system estimated; return how the run ended."""
    written = out / WORK / "out"
    outcome, detail = _how_it_ended(told, system.time_limit.of(len(given)))
    if outcome is Outcome.FINISHED:
        found = normalised(written, system.writes, given.stamps_s, colour=given.stored.rgb_files)
        outcome, detail = found.outcome, _sentences(found.detail, _take_files(system, given, written, out, maps=maps))
        if outcome is Outcome.FINISHED:
            _write_estimate(out / ESTIMATE, found)
    return RunRecord(
        system=system.name,
        outcome=outcome,
        detail=detail,
        frames=len(given),
        seconds=round(told.get("seconds", 0.0), 3),
        processor_s=_rounded(told.get("processor_s")),
        peak_memory_bytes=told.get("peak_memory_bytes"),
        exit_status=told.get("status"),
        versions=versions,
    )


def _how_it_ended(told: dict[str, Any], limit_s: float) -> tuple[Outcome, str]:
    if told["ended"] == "limit":
        return Outcome.TIMED_OUT, f"was stopped after {limit_s:g} s; {LOG} holds what it said"
    if told["ended"] == "missing":
        return Outcome.CRASHED, told["problem"]
    status = told["status"]
    if status == 0:
        return Outcome.FINISHED, ""
    ended = f"ended with status {status}" if status > 0 else f"was ended by {_signal_name(-status)}"
    return Outcome.CRASHED, f"{ended}; {LOG} holds what it said"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _take_files(system: System, given: Given, written: Path, out: Path, *, maps: bool) -> str:
    """Take over what else of the contract a system wrote; return sentences on what is wrong in it."""
    problems = []
    if system.writes.keyframes and found_file(written, system.writes.keyframes) is not None:
        keyframes = normalised(
            written, system.writes, given.stamps_s, system.writes.keyframes, colour=given.stored.rgb_files
        )
        if keyframes.outcome is Outcome.FINISHED:
            _write_estimate(out / KEYFRAMES, keyframes)
        else:
            problems.append(f"its keyframes are not used: {keyframes.detail}")
    if (written / FRAMES).is_file():
        if problem := _states_problem(written / FRAMES, len(given)):
            problems.append(f"its {FRAMES} is not used: {problem}")
        else:
            Mover(out).move(written / FRAMES, out / FRAMES)
    if maps and (written / MAP).is_file():
        Mover(out).move(written / MAP, out / MAP)
    return _sentences(*problems)


def _states_problem(path: Path, frames: int) -> str:
    """Return what is wrong in a list of the frames' states; "" where nothing is."""
    try:
        rows = list(csv.reader(read_text(path).splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        return f"it cannot be read: {error}"
    if not rows or rows[0][:3] != ["index", "stamp_s", "state"]:
        return "its header does not begin with index,stamp_s,state"
    for number, row in enumerate(rows[1:], 2):
        if len(row) < 3 or not row[0].isdecimal() or int(row[0]) >= frames or row[2] not in STATES:
            return f"line {number} names no frame with a state of {', '.join(STATES)}"
    return ""


def _write_estimate(path: Path, found: Normalised) -> None:
    write_atomic(path, estimate_text(found.estimate).encode(), path.parent)


def _sentences(*parts: str) -> str:
    return "; ".join(part for part in parts if part)


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)
