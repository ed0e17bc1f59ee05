# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders of studies' results, whose tables, records and paths are changed by structure, read for their report."""

import functools
import json
import shutil

from fuzz.mutation import pick
from fuzz.structure import beside, kept, note, text_changed
from results_made import SETTINGS, make_results

from noisy_world.core.errors import InputError
from noisy_world.evaluate import report_sections, run_figures
from noisy_world.evaluate.report_tables import picked_runs, picked_sequences
from noisy_world.evaluate.report_tables import read_results
from noisy_world.evaluate.study_results import ResultsFolder
from noisy_world.evaluate.study_tables import write_tables

TASK = "task.json"
FEW = {"systems": ("rgbd_odometry", "orb_slam3"), "scenes": ("room0",), "settings": SETTINGS[:4], "seeds": ("1",)}
WORDS = (
    "room0", "clean", "finished", "crashed", "strict", "paper", "nan", "inf", "seed", "gaussian_noise", "dynamic",
    "ate_rmse_m",
)  # fmt: skip


@functools.cache
def _base():
    """Return a folder of results, made once in a process."""
    folder = kept("results") / "results"
    make_results(folder, **FEW)
    for path in folder.rglob("run.json"):  # as a study writes them
        record = {"processor_s": None, "peak_memory_bytes": None, "exit_status": 0, **json.loads(path.read_text())}
        path.write_text(json.dumps(record))
    return folder


def write(folder, rng):
    """Write a folder of results and change one or two of its files."""
    beside(folder)
    out = folder / "out"
    shutil.copytree(_base(), out)
    told = []
    for _ in range(1 + int(rng.integers(4) == 0)):
        top = [out / "study.json", *sorted((out / "tables").iterdir())] * 6
        rest = [path for path in sorted(out.rglob("*")) if path.suffix in (".json", ".csv", ".txt")]
        told += text_changed(pick(rng, top + rest), rng, words=WORDS)
    (folder / TASK).write_text(json.dumps(pick(rng, ("read", "read", "tables"))))
    note(folder, told)


def read(folder):
    """Read the results as the report does, up to the drawing, or write the tables anew."""
    out = folder / "out"
    if json.loads((folder / TASK).read_text()) == "tables":
        results = ResultsFolder(out)
        try:
            write_tables(results)
        finally:
            results.tidy()
        return
    found = read_results(out)
    if len(found.runs) > 1000:
        raise InputError(out, "has many runs")
    missing = []
    for pick_ in picked_runs(found):
        run_figures._path(found, pick_, missing)
    for runs in picked_sequences(found):
        run_figures._times(found, runs, missing)
    run_figures.worst_frames(found, missing)
    told = [
        report_sections.opening(found),
        *report_sections.facts(found),
        report_sections.again(found),
        report_sections.command(found),
    ]
    assert told
    assert all(line.isprintable() for line in missing)
