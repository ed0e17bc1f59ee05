# SPDX-License-Identifier: GPL-3.0-or-later
"""How a command ends: what its user can mend is one line and an exit status; a bug keeps its traceback."""

import argparse
from collections.abc import Callable, Iterable

from ..core.requirements import NEEDED
from .entry import INTERRUPTED, Entry, say
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
    busy: the exit status where another process does the same. options: say in --progress json too what is wrong.
    """

    def wrong(text: str) -> None:
        entry.complain(text)
        if options is not None and options.progress == "json":
            from .running import machine_listener

            machine_listener().tell({"error": text})

    if problem := missing_package(needs, entry):
        wrong(problem)
        return 1
    from ..core.errors import BusyError, InterruptedRunError, NoisyWorldError

    try:
        return work()
    except InterruptedRunError:
        say(f"stopped; {stopped}")
        return INTERRUPTED
    except NoisyWorldError as error:
        wrong(str(error))
        return busy if isinstance(error, BusyError) else 1
