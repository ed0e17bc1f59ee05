# SPDX-License-Identifier: GPL-3.0-or-later
"""How a command ends: what its user can mend is one line and an exit status; a bug keeps its traceback."""

import argparse
import io
import os
import select
import sys
from collections.abc import Callable, Iterable

from ..core.exit_statuses import INTERRUPTED, READER_GONE
from ..core.requirements import NEEDED
from .entry import Entry, say
from .missing import missing_package

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
            from .running import machine_listener

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
