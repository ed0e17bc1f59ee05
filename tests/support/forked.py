# SPDX-License-Identifier: GPL-3.0-or-later
"""Forking where it is safe: from a process that has no threads.

Tests share a process with others whose libraries have started threads, and a process that is forked from such a one may
crash in a library's handlers: Ray's ends with a segmentation fault.
"""

from typing import ParamSpec, TypeVar
import multiprocessing
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

import pytest

P = ParamSpec("P")
Result = TypeVar("Result")
LIMIT_S = 300  # the slowest of these takes a tenth of it


def in_new_process(function: Callable[P, Result], *arguments: P.args, **named: P.kwargs) -> Result:
    """Return what a module's function gives in a new process, which may be forked; skip where no system forks.

    Raises TimeoutError where it hangs.
    """
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("this system cannot fork")
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        try:
            return pool.submit(function, *arguments, **named).result(LIMIT_S)
        except TimeoutError:
            for child in multiprocessing.active_children():  # or the pool would wait for it
                child.kill()
            raise
