# SPDX-License-Identifier: GPL-3.0-or-later
"""Many cases in processes of their own: one that hangs or dies is a finding, and its process is replaced."""

import faulthandler
import multiprocessing
import multiprocessing.connection
import os
import re
import resource
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
    waiting = iter(cases)
    workers = [_Worker(seed, folder / f"worker{k}") for k in range(processes)]
    try:
        for worker in workers:
            worker.hand(next(waiting, None))
        while busy := [worker for worker in workers if worker.case is not None]:
            first = min(worker.deadline(limit_s) for worker in busy)
            multiprocessing.connection.wait([worker.pipe for worker in busy], max(0.0, first - time.monotonic()))
            for worker in busy:
                if (outcome := worker.outcome(limit_s)) is not None:
                    yield (*worker.case, outcome, time.monotonic() - worker.began)
                    worker.hand(next(waiting, None))
    finally:
        for worker in workers:
            worker.end()


@dataclass
class _Worker:
    """A process that runs cases, one after another."""

    seed: int
    folder: Path
    case: tuple[str, int] | None = None
    began: float = 0.0
    process: Any = None
    pipe: Any = None

    def _start(self):
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs, self.seed, self.folder), daemon=True)
        self.process.start()
        theirs.close()
        if not self.pipe.poll(START_S) or self.pipe.recv() != "ready":
            raise RuntimeError("a process for cases does not start")

    def hand(self, case):
        """Give the process a case; None is the end."""
        self.case = case
        if case is not None:
            if self.process is None:
                self._start()
            self.pipe.send(case)
            self.began = time.monotonic()

    def deadline(self, limit_s):
        """Return when the case has to be finished."""
        return self.began + limit_s

    def outcome(self, limit_s):
        """Return how the case ended, or None while it runs."""
        if self.pipe.poll():
            try:
                return self.pipe.recv()
            except EOFError:
                self.process.join()
                status = self.process.exitcode
                self.end()
                return Outcome("finding", f"crash: the process ended with status {status}")
        if time.monotonic() > self.deadline(limit_s):
            self.end()
            return Outcome("finding", f"hang: more than {limit_s:g} s")
        return None

    def end(self):
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.join()
            self.pipe.close()
        self.process = self.pipe = None


def _work(pipe, seed, folder):
    """Run the cases that come through the pipe, and say how each ended. What libraries print is a finding, too."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    folder.mkdir(parents=True, exist_ok=True)
    printed = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the process
    for stream in (1, 2):
        os.dup2(printed.fileno(), stream)
    faulthandler.enable()
    pipe.send("ready")
    while True:
        try:
            area, number = pipe.recv()
        except EOFError:
            return
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
        expected = all(map(lines.match, told.splitlines()))
        if told and outcome.kind != "finding" and not expected:
            outcome = Outcome("finding", f"printed ({outcome.kind}): {told[:300]!r}")
        pipe.send(outcome)
