# SPDX-License-Identifier: GPL-3.0-or-later
"""How a command is started, what it needs, how it is stopped, and how it ends."""

import argparse
import io
import os
import select
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from types import FrameType
from typing import IO, TYPE_CHECKING, Any, TextIO

from ..core.errors import INTERRUPTED, READER_GONE
from ..core.packages import NEEDED, blender_missing, missing_packages, missing_sentence, old_opencv
from ..core.progress import JsonProgress, PlainProgress, Progress, TerminalProgress
from .system_libraries import advice, missing_libraries

if TYPE_CHECKING:
    from ..executors.jobs import Executor


@dataclass(frozen=True)
class Entry:
    """What differs between the ways to start a subcommand.

    name: the beginning of its messages, such as "generate.py".
    words: the command that starts it again, without the subcommand's arguments.
    whose_python: whose Python this is, such as "this Blender's "; empty for a plain Python.
    remedy: what to do where packages are missing. blender_remedy: what to do where Blender is, if it is another thing
    than to install the extra `blender`.
    """

    name: str
    words: tuple[str, ...]
    whose_python: str = ""
    remedy: str = "install them with pip"
    blender_remedy: str = ""

    def command(self, arguments: Sequence[str]) -> list[str]:
        """Return the command that starts the subcommand again."""
        return [*self.words, *arguments]

    def pasteable(self, arguments: Sequence[str]) -> str:
        """Return the command as text to paste into a shell."""
        return shlex.join(self.command(arguments))

    def complain(self, text: str) -> None:
        """Print a line on what is wrong."""
        say(f"{self.name}: {text}")


def say(text: str) -> None:
    """Print a line for the user on standard error; standard output is for the command's result."""
    print(text, file=sys.stderr, flush=True)


# --- packages and libraries that are missing ---


# What Blender warns of on standard output when it is imported, which is of use only to its windows: that /etc/mtab is
# missing, from which its file browser lists the disks, and that the locale that LANG names is not installed.
OF_NO_USE_HERE = (b"Could not get a list of mounted file-systems", b"Falling back to standard locale")


def missing_package(names: Iterable[str], entry: Entry) -> str:
    """Return which packages are missing or too old and the command that installs them; "" where none is."""
    names = list(names)
    missing = missing_packages(names)
    if missing:
        return missing_sentence(missing, entry.whose_python, entry.remedy)
    return old_opencv() if "cv2" in names else ""


def blender_problem(entry: Entry) -> str:
    """Import Blender; if that fails, return the problem and, of a missing package or system library, what to do."""
    if problem := blender_missing(remedy=entry.blender_remedy):
        return problem
    try:
        with _relevant_output():
            import bpy  # noqa: F401 - imported only to see whether it can be
    except ImportError as error:
        if names := missing_libraries():
            return advice(names)
        return f"bpy cannot be imported: {error}"
    return ""


def blender_lacks(entry: Entry) -> str:
    """Return what is missing for Blender to be imported, without importing it: its package, or system libraries."""
    if problem := blender_missing(remedy=entry.blender_remedy):
        return problem
    names = missing_libraries()
    return advice(names) if names else ""


@contextmanager
def _relevant_output() -> Iterator[None]:
    """Hold back what is printed to standard output, by C code too, and then print it without what is OF_NO_USE_HERE."""
    if sys.platform != "linux":
        yield
        return
    sys.stdout.flush()
    kept = os.dup(1)
    with os.fdopen(os.memfd_create("standard output"), "w+b") as held:
        os.dup2(held.fileno(), 1)
        try:
            yield
        finally:
            sys.stdout.flush()
            os.dup2(kept, 1)
            os.close(kept)
            held.seek(0)
            os.write(1, b"".join(line for line in held if not any(text in line for text in OF_NO_USE_HERE)))


# --- how a command ends: what its user can mend is one line; a bug keeps its traceback ---


CONTINUES = "finished frames stay, and the same command continues from there"


def ended(
    work: Callable[[], int],
    entry: Entry,
    *,
    needs: Iterable[str] = NEEDED,
    stopped: str = CONTINUES,
    busy: int = 1,
    options: argparse.Namespace | None = None,
) -> int:
    """Do a command's work and return the exit status.

    needs: the packages without which nothing is begun. stopped: what follows "stopped; " where a signal ended it.
    busy: the exit status where another process does the same. options: where they say --progress json, what is wrong is
    said in that form too.
    """

    def wrong(text: str) -> None:
        entry.complain(text)
        if getattr(options, "progress", "text") == "json":
            machine_listener().tell({"error": text})

    if problem := missing_package(needs, entry):
        wrong(problem)
        return 1
    from ..core.errors import BusyError, InterruptedRunError, NoisyWorldError, memory_errors

    try:
        with memory_errors():
            return work()
    except InterruptedRunError:
        say(f"stopped; {stopped}")
        return INTERRUPTED
    except NoisyWorldError as error:
        wrong(error.message)
        return busy if isinstance(error, BusyError) else 1


def exit_status(work: Callable[[], int]) -> int:
    """Run a whole command line and return the exit status of its process.

    Where nobody reads its output any more, as after `| head`, it ends without a word, as Unix tools do; where its
    output cannot be written, as on a full disk, with a line.
    """
    _open_streams()
    try:
        try:
            status = work()
        except SystemExit:  # the parser's, after --help for instance
            sys.stdout.flush()
            raise
        sys.stdout.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        if not (gone := [number for number in (1, 2) if _reader_is_gone(number)]):
            raise  # of another pipe, to a process that this one has started
        _put_devnull(gone)
        return READER_GONE
    except OSError as error:
        if error.filename is not None or not _output_fails():
            raise  # of another file
        _put_devnull((1,))
        say(f"standard output cannot be written: {error.strerror or error}")
        return 1
    return status


def _open_streams() -> None:
    """Have all three standard streams: where one is closed, as a daemon's are, what goes there is dropped.

    Otherwise the next file that is opened would be that stream. What the stream's encoding lacks is shown escaped.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
        if getattr(sys, name) is None:  # so Python says that it was closed
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115 - it stays open
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")


def _output_fails() -> bool:
    """Tell whether nothing more can be written to standard output."""
    try:
        sys.stdout.flush()
        os.write(1, b"\n")
    except OSError:
        return True
    return False


def _put_devnull(numbers: Iterable[int]) -> None:
    """Drop what goes to some streams: Python writes what is left when it ends, and would complain."""
    for number in numbers:
        os.dup2(os.open(os.devnull, os.O_WRONLY), number)


def _reader_is_gone(number: int) -> bool:
    """Tell whether a descriptor is a pipe that nobody reads."""
    if not hasattr(select, "poll"):
        return True  # Windows cannot be asked
    poll = select.poll()
    poll.register(number, 0)
    return any(event & select.POLLERR for _, event in poll.poll(0))


# --- long commands: progress, and stopping by a signal ---


def listener(form: str) -> tuple[Progress, threading.Event]:
    """Return the listener for a run's progress, and the event that stops the run.

    form: "text" for people, "json" for programs.
    """
    if form == "json":
        stop = stop_on_signal(None)
        return machine_listener(stop.set), stop
    # A copy of the stream, as the original descriptors are redirected while Blender renders, to hide its output.
    stream = os.fdopen(os.dup(sys.stderr.fileno()), "w", buffering=1)
    return text_listener(stream), stop_on_signal(stream)


def text_listener(stream: TextIO) -> Progress:
    """Return the listener for people who read a stream: a bar for a terminal, lines for a log file."""
    # A terminal that does not know its size shows no bar.
    watched = stream.isatty() and os.get_terminal_size(stream.fileno()).lines > 1
    return TerminalProgress(stream) if watched else PlainProgress(stream)


def machine_listener(lost: Callable[[], object] = lambda: None) -> JsonProgress:
    """Return a listener for the program that started this one; `lost` is called when that program is gone."""
    sys.stdout.flush()
    return JsonProgress(os.fdopen(os.dup(1), "w", buffering=1), lost=lost)


def stop_on_signal(stream: IO[str] | None) -> threading.Event:
    """Let Ctrl-C and a batch system's SIGTERM end the run after the current frame; a second Ctrl-C ends it at once."""
    stop = threading.Event()

    def handle(number: int, _: FrameType | None) -> None:
        if stop.is_set() and number == signal.SIGINT:
            raise KeyboardInterrupt
        stop.set()
        if stream is not None:
            print("\nstopping after the current frames", file=stream, flush=True)

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    return stop


def executor_of(
    options: argparse.Namespace, entry: "Entry", jobs: int, work: Callable[[], int] | None = None
) -> "AbstractContextManager[Executor]":
    """Return what carries out tasks: the cluster that the options name, or else processes of this machine.

    work: what those do that are split from this one; see `WorkerProcesses`.
    """
    if options.ray is not None:
        from ..executors.ray_cluster import ray_cluster

        return ray_cluster(options.ray, options.cpus)
    from ..executors.processes import WorkerProcesses

    return WorkerProcesses(entry.command(["--worker"]), jobs, work)


def work_on(prepare: Callable[..., AbstractContextManager[Any]], answer: Callable[[], Any] | None = None) -> int:
    """Be a worker: do tasks for the process that started this one; return the exit status.

    prepare: as `executors.jobs.Prepare`, and takes the event that stops it as `stop`. answer: as of `worker.work`.
    """
    from ..executors.jobs import work

    stop = stop_on_signal(None)
    return work(partial(prepare, stop=stop), stop, answer)
