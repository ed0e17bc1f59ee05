# SPDX-License-Identifier: GPL-3.0-or-later
"""Exit statuses of commands."""

DONE = 0
USERS_ERROR = 1  # a line on standard error says what to mend
REFUSED = 3  # of a worker on a machine that could not do any task as the others do
BUSY = 75  # of one whose task another process does; EX_TEMPFAIL of sysexits.h
INTERRUPTED = 130  # 128 + SIGINT (2): the exit status that shells give a program ended by Ctrl-C
KILLED = 9  # the signal that nothing hears: the system's, where memory is short
READER_GONE = 141  # 128 + SIGPIPE (13): that of a program whose output nobody reads any more


def how_it_ended(status: int) -> str:
    """Return in words how a process ended that did not mean to. status: negative where a signal ended it."""
    if status >= 0:
        return f"ended with status {status}"
    return f"was ended by signal {-status}{', perhaps for want of memory' if status == -KILLED else ''}"
