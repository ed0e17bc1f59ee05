# SPDX-License-Identifier: GPL-3.0-or-later
"""Running a system on a sequence: whatever the system does becomes a record, in a folder of the same few files."""

import contextlib
import csv
import os
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..core.atomic_files import Mover, storage_errors, write_atomic
from ..core.errors import InputError, InterruptedRunError, MissingDependencyError, NotFiniteError, one_line
from ..core.file_access import check_regular, parse_json, read_text
from ..core.geometry import Intrinsics
from ..core.packages import PACKAGE
from ..trajectories.formats import TRAJECTORY_FORMATS
from ..trajectories.pose_files import LARGEST_READ_BYTES, OverLimitError
from .cases import ESTIMATE, FRAMES, KEYFRAMES, MAP, RUN, Outcome, RunRecord, estimate_text
from .estimates import Asked, Estimate, Frames, estimate_of, match_frames, read_poses
from .system_input import SequenceInput, sequence_input
from .system_isolation import (
    CommandOutcome,
    isolated,
    isolated_variables,
    isolation_problem,
    own_folders,
    program_folders,
    watched,
)
from .systems import STUDY_NAMES, System, Writes, environment_folder, environment_python, filled

# Reads what a system wrote: only regular files in its own folder, and none larger than its limits.


LONGEST_SENTENCE = 400  # characters


def output_file(folder: Path, pattern: str) -> Path | None:
    """Return what a name or a pattern stands for in a system's folder; the first by name of several, None of none.

    It may be anything but a folder: `check_output` tells.
    """
    with contextlib.suppress(OSError):  # a name too long, or a folder that may not be listed
        return min((path for path in folder.glob(pattern) if not _is_folder(path)), default=None)
    return None


def check_output(path: Path, folder: Path, largest_bytes: int | None, key: str) -> None:
    """Raise InputError where a file that a system left is not to be read.

    That is: a pipe, a socket, a device or a link that leads out of the system's folder; OverLimitError where it has
    more bytes than the limit, which `key` names in the system's definition; None for any.
    """
    if not _inside(path, folder):
        raise InputError(path, "is a link that leads out of the folder that the system writes into")
    try:
        check_regular(path)
        size = path.stat().st_size
    except OSError as error:
        raise InputError(path, str(error.strerror or error)) from None
    if largest_bytes is not None and size > largest_bytes:
        raise OverLimitError(path, f"has more than the {largest_bytes / 1e6:g} MB of {key}")


def sentence(text: str) -> str:
    """Return a text of a system as a line that a terminal and a file of JSON take, not longer than a sentence."""
    line = one_line(text[: LONGEST_SENTENCE + 1])
    return line if len(line) <= LONGEST_SENTENCE else f"{line[:LONGEST_SENTENCE]}..."


def remove_tree(path: Path) -> bool:
    """Remove a folder, or what stands in its place, whatever a system has done to it; tell whether it is gone."""

    def permit(function: Callable[..., object], name: str, error: object) -> None:
        del error
        with contextlib.suppress(OSError):
            os.chmod(os.path.dirname(name), stat.S_IRWXU)  # noqa: PTH101, PTH120 - a name may be too long for a Path
            if function in (os.rmdir, os.unlink):
                function(name)

    if path.is_symlink() or (os.path.lexists(path) and not path.is_dir()):
        with contextlib.suppress(OSError):
            path.unlink()
        return not os.path.lexists(path)
    with contextlib.suppress(RecursionError, OSError):
        if sys.version_info >= (3, 12):
            shutil.rmtree(path, onexc=permit)
        else:
            shutil.rmtree(path, onerror=permit)
    if os.path.lexists(path):  # folders without permissions, or nested more deeply than there are open files
        for command in (("chmod", "-R", "u+rwX"), ("rm", "-rf")):
            subprocess.run(  # noqa: S603 - a path of ours
                [*command, "--", os.fspath(path)], stdin=subprocess.DEVNULL, capture_output=True, check=False
            )
    return not os.path.lexists(path)


def restore_folder(folder: Path, keep: tuple[str, ...]) -> None:
    """Make a folder, which was there before a system ran, a folder again, with nothing in it but regular files to keep.

    A system may have put a file or a link in the place of the folder, or of one above it. keep: names; one of a folder
    stays as it is.
    """
    for above in (*reversed(folder.parents), folder):
        if os.path.lexists(above) and (above.is_symlink() or not above.is_dir()):
            above.unlink()
    folder.mkdir(parents=True, exist_ok=True)
    for item in folder.iterdir():
        plain = not item.is_symlink() and (item.is_file() or item.is_dir())
        if item.name not in keep or not plain:
            remove_tree(item)


def _is_folder(path: Path) -> bool:
    with contextlib.suppress(OSError):
        return path.is_dir()
    return False


def _inside(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # links in a circle
        return False


# Whether a system can be run here, before anything is made for it: its program, its environment, its GPU.


PROGRAMS = PACKAGE / "evaluate" / "programs"
GPU_DEVICES = (Path("/dev/nvidiactl"), Path("/dev/dxg"))
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
VERSIONS_LIMIT_S = 120.0
_OF_A_RUN = dict.fromkeys(("frames", "sequence", "out", *STUDY_NAMES), "")
"""Placeholders that have no value before a run."""


def check_system(system: System) -> dict[str, str]:
    """Return the versions of a system that can be run here.

    Raises MissingDependencyError with the remedy where its environment, its program or its GPU is not there, or its
    command for versions fails.
    """
    return system_versions(system)


@cache
def system_versions(system: System) -> dict[str, str]:
    """Return what a system says of its versions, asked once. Raises MissingDependencyError."""
    if system.environment and not environment_python(system.environment).exists():
        raise _missing(system, f"there is no environment {environment_folder(system.environment)}")
    if system.gpu and not any(device.exists() for device in GPU_DEVICES):
        raise _missing(system, "no NVIDIA GPU is here")
    program = _program(system)
    if shutil.which(program) is None:
        raise _missing(system, f"there is no program {program}")
    if system.isolate == "bubblewrap" and (problem := isolation_problem()):
        message = f"system {system.name} cannot be isolated by bubblewrap: {problem}"
        raise MissingDependencyError(f"{message}; or leave out isolate")
    return _asked_versions(system) if system.versions else {}


def command_values(system: System) -> dict[str, Path | str]:
    """Return the values of the placeholders that are the same for all runs of a system."""
    named = system.environment
    return {
        "python": environment_python(named) if named else sys.executable,
        "environment": environment_folder(named) if named else "",
        "programs": PROGRAMS,
        "here": system.file.parent,
    }


def variables_of(system: System) -> dict[str, str]:
    """Return the environment variables of a system's processes."""
    own = dict(os.environ)
    for name in ("PYTHONPATH", "PYTHONHOME"):
        own.pop(name, None)
    if not system.environment:  # its {python} is this one, which may have this package from a checkout
        own["PYTHONPATH"] = os.pathsep.join(filter(None, (str(PACKAGE.parent), os.environ.get("PYTHONPATH"))))
    own["PYTHONUNBUFFERED"] = "1"  # so that the log of a process that is ended is whole
    if system.threads is not None:
        own.update(dict.fromkeys(THREAD_VARIABLES, str(system.threads)))
    return own | dict(variable.split("=", 1) for variable in system.variables)


def prepared(system: System, command: list[str], work: Path) -> tuple[list[str], dict[str, str]]:
    """Return a command as it is started, isolated where the system is, and its environment variables.

    work: a folder of ours with the folders out, tmp and given.
    """
    variables = variables_of(system)
    if system.isolate == "none":
        return command, variables
    reads = [work / "given", PACKAGE.parent, *own_folders(), *program_folders(command[0]), *reached(system)]
    own = [*(variable.split("=", 1)[0] for variable in system.variables), *THREAD_VARIABLES]
    inside = isolated(command, reads=reads, out=work / "out", temporary=work / "tmp", gpu=system.gpu)
    return inside, isolated_variables(variables, own)


def reached(system: System) -> list[Path]:
    """Return what an isolated system may read by its definition: its folder where it names it, and what it reaches."""
    words = [*system.command, *system.map_arguments, *system.versions, *system.variables]
    named = [system.file.parent] if any("{here}" in word for word in words) else []
    if system.environment:
        named.append(environment_folder(system.environment))
    return [*named, *((system.file.parent / Path(name).expanduser()) for name in system.reaches)]


def _program(system: System) -> str:
    (program,) = filled(system.command[:1], {**command_values(system), **_OF_A_RUN})
    return program


def _asked_versions(system: System) -> dict[str, str]:
    command = filled(system.versions, {**command_values(system), **_OF_A_RUN})
    with tempfile.TemporaryDirectory(prefix="noisy-world-versions-", ignore_cleanup_errors=True) as name:
        work = Path(name).resolve()
        for folder in ("out", "tmp", "given"):
            (work / folder).mkdir()
        started, variables = prepared(system, command, work)
        output, errors = work / "said.txt", work / "errors.txt"
        outcome = watched(
            started,
            variables,
            [work / "out", work / "tmp"],
            output,
            system.limits,
            limit_s=VERSIONS_LIMIT_S,
            grace_s=0.0,
            errors=errors,
        )
        try:
            texts = [read_text(file, errors="replace") for file in (output, errors)]
        except OSError:  # it has removed or replaced them, so it says nothing
            texts = ["", ""]
    if outcome.ended == "limit":
        raise _missing(system, f"its command for versions took more than {VERSIONS_LIMIT_S:g} s")
    if outcome.ended != "itself":
        raise _missing(system, sentence(f"its command for versions failed: {outcome.problem}"))
    if outcome.status != 0:
        lines = [line for line in texts[1].splitlines() if line.strip()]
        raise _missing(
            system, sentence(lines[-1]) if lines else f"its command for versions ended with {outcome.status}"
        )
    return _texts(system, texts[0])


def _texts(system: System, output: str) -> dict[str, str]:
    """Return the object of texts in the last line of what a command output: libraries may speak before it."""
    lines = output.strip().splitlines()
    try:
        value: Any = parse_json(lines[-1] if lines else "")
    except ValueError:
        value = None
    if not isinstance(value, dict) or not all(isinstance(text, str) for text in value.values()):
        problem = "its command for versions does not print a JSON object of texts in its last line"
        raise _missing(system, problem)
    return {sentence(name): sentence(value[name]) for name in sorted(value)}


def _missing(system: System, problem: str) -> MissingDependencyError:
    remedy = f"; {system.remedy}" if system.remedy else ""
    return MissingDependencyError(f"system {system.name} cannot be run here: {problem}{remedy}")


# What a system wrote, read as its definition says, as poses of the frames that it was given.


@dataclass(frozen=True)
class Normalised:
    """How an estimate was read. estimate: empty unless outcome is FINISHED. detail: a sentence, "" for nothing."""

    outcome: Outcome
    detail: str
    estimate: Estimate


NOTHING = Estimate(np.empty(0), np.empty((0, 4, 4)))


def normalised(
    folder: Path,
    writes: Writes,
    stamps_s: list[float],
    pattern: str = "",
    *,
    colour: Sequence[Path] = (),
    largest_bytes: int = LARGEST_READ_BYTES,
) -> Normalised:
    """Read the estimate that a system wrote into a folder.

    stamps_s: of the frames that it was given. pattern: of the file; that of the estimate if it is "". colour: the
    frames' images, for a format that names them. largest_bytes: more of an estimate is not read.
    """
    path = output_file(folder, pattern or writes.file)
    if path is None:
        return Normalised(Outcome.NO_ESTIMATE, f"it wrote no {pattern or writes.file}", NOTHING)
    frames = Frames.of(stamps_s, colour)
    asked = Asked(writes.direction, writes.axes, writes.stamps, writes.stamp_unit, largest_bytes)
    try:
        parts = writes.format in TRAJECTORY_FORMATS and TRAJECTORY_FORMATS[writes.format].reads_parts
        check_output(path, folder, None if parts else largest_bytes, "limits.estimate_mb")
        read = read_poses(path, writes.format, asked, frames.stamps_s)
        estimate = estimate_of(path, read, frames)
    except InputError as error:
        return _unread(error)
    matched, others = match_frames(estimate, frames.stamps_s)
    notes = [*read.notes, *([others] if others else [])]
    return Normalised(Outcome.FINISHED, "; ".join(notes), matched)


def _unread(error: InputError) -> Normalised:
    where = f"{error.where}: " if error.where else ""
    outcome = Outcome.NOT_FINITE if isinstance(error, NotFiniteError) else Outcome.UNREADABLE
    if isinstance(error, OverLimitError):
        outcome = Outcome.OVER_LIMIT
    return Normalised(outcome, f"{Path(error.file).name}: {where}{error.problem}", NOTHING)


LOG = "log.txt"
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
    given = sequence_input(sequence, system.reads.modalities, camera, links=system.isolate != "none")
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
    write_atomic(out / RUN, record.text().encode(), out)
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


def _command(system: System, given: SequenceInput, work: Path, names: Mapping[str, str], *, maps: bool) -> list[str]:
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
    system: System, given: SequenceInput, ended: CommandOutcome, out: Path, written: Path, *, maps: bool
) -> RunRecord:
    """Write what the system estimated; return how the run ended."""
    outcome, detail = _how_it_ended(ended, system.time_limit.of(len(given)))
    if outcome is Outcome.FINISHED:
        estimated = _estimated(system, given, written)
        outcome, detail = estimated.outcome, estimated.detail
        if outcome is Outcome.FINISHED:
            _write_estimate(out / ESTIMATE, estimated)
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


def _estimated(system: System, given: SequenceInput, written: Path, pattern: str = "") -> Normalised:
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


def _take_files(system: System, given: SequenceInput, written: Path, out: Path, *, maps: bool) -> list[str]:
    """Take over what else of the contract a system wrote; return sentences on what is wrong in it."""
    problems = []
    limits = system.limits
    if system.writes.keyframes and output_file(written, system.writes.keyframes) is not None:
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


def _write_estimate(path: Path, estimated: Normalised) -> None:
    write_atomic(path, estimate_text(estimated.estimate).encode(), path.parent)


def _sentences(*parts: str) -> str:
    return "; ".join(part for part in parts if part)


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 3)
