# SPDX-License-Identifier: GPL-3.0-or-later
"""Many cases in processes of their own: one that hangs or dies is a finding, and its process is replaced."""

import faulthandler
import multiprocessing
import os
import queue
import re
import resource
import sys
import tempfile
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from fuzz.cases import OF_BLENDER, Outcome, run_case

MEMORY_BYTES = 6 * 2**30  # of addresses; libraries and threads take most of what is used
START_S = 120
DECODERS = re.compile(r"libpng |\[ ?(?:WARN|ERROR|INFO):|Corrupt JPEG|Premature end|JPEG|.*JPEG")
"""What the libraries of images print of a damaged file, beside the error that refuses it."""
DAMAGED_SCAN = re.compile(r"Corrupt JPEG data|Premature end of JPEG")
"""What libjpeg prints of a file that it reads nevertheless: nothing else could tell."""
FFMPEG = re.compile(r"(?s)(?!Traceback|.*Warning:).*")
"""What FFmpeg prints of a video, in words of many kinds, which may hold bytes of the file."""


def run_cases(cases, seed, folder, *, processes=2, limit_s=10.0):
    """Yield (area, number, outcome, seconds) of each case, as they end.

    cases: (area, number). folder: where inputs are written, a folder for each process. limit_s: for one case.
    """
    waiting, taking, ended = iter(cases), threading.Lock(), queue.SimpleQueue()

    def work(place):
        pool = None
        while True:
            with taking:
                case = next(waiting, None)
            if case is None:
                break
            if pool is None:
                pool = _process()
            began = time.monotonic()
            try:
                outcome = pool.submit(_run, *case, seed, folder / f"worker{place}").result(limit_s)
            except TimeoutError:
                outcome = Outcome("finding", f"hang: more than {limit_s:g} s")
            except BrokenProcessPool:
                outcome = Outcome("finding", "crash: the process ended")
            ended.put((*case, outcome, time.monotonic() - began))
            if outcome.told.startswith(("hang", "crash")):
                pool = _end(pool)
        _end(pool)
        ended.put(None)

    for place in range(processes):
        threading.Thread(target=work, args=(place,), daemon=True).start()
    left = processes
    while left:
        if (found := ended.get()) is None:
            left -= 1
        else:
            yield found


def _process():
    """Start a process for cases."""
    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin)
    pool.submit(int).result(START_S)
    return pool


def _end(pool):
    """End a process, whatever it does; return None in its place."""
    for process in () if pool is None else list((pool._processes or {}).values()):
        process.kill()
    if pool is not None:
        pool.shutdown(wait=False, cancel_futures=True)


_PRINTED = []


def _begin():
    """Limit this process, and hear what libraries print in it."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    _PRINTED.append(tempfile.TemporaryFile())  # noqa: SIM115 - as long as the process
    for stream in (1, 2):
        os.dup2(_PRINTED[0].fileno(), stream)
    faulthandler.enable()


def _run(area, number, seed, folder):
    """Run a case; what libraries print is a finding, too."""
    folder.mkdir(parents=True, exist_ok=True)
    printed = _PRINTED[0]
    printed.truncate(0)
    printed.seek(0)
    outcome = run_case(area, seed, number, folder / "case")
    sys.stdout.flush()
    sys.stderr.flush()
    printed.seek(0)
    told = printed.read().decode("utf-8", "replace").strip()
    if area in OF_BLENDER:  # which prints as it likes, and nobody hears it but a pipe
        told = ""
    lines = FFMPEG if area == "videos" else DECODERS if outcome.kind == "refused" else DAMAGED_SCAN
    if told and outcome.kind != "finding" and not all(map(lines.match, told.splitlines())):
        return Outcome("finding", f"printed ({outcome.kind}): {told[:300]!r}")
    return outcome
