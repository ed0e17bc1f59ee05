# SPDX-License-Identifier: GPL-3.0-or-later
"""Folders of studies' results, whose tables, records and paths are changed by structure, read for their report."""

import functools
import json
import shutil
import tempfile
from pathlib import Path

from fuzz.mutation import pick
from fuzz.structure import OF_NUMBERS, as_json, as_table, changed, note, raws
from results_made import SETTINGS, make_results

from noisy_world.core.errors import InputError
from noisy_world.evaluation.report import evaluated, run_pictures
from noisy_world.evaluation.report.picks import picked_runs, picked_sequences
from noisy_world.evaluation.report.reading import read_results
from noisy_world.evaluation.study.results import ResultsFolder
from noisy_world.evaluation.study.tables import write_tables

TASK = "task.json"
FEW = {"systems": ("rgbd_odometry", "orb_slam3"), "scenes": ("room0",), "settings": SETTINGS[:4], "seeds": ("1",)}
WORDS = (
    "room0", "clean", "finished", "crashed", "strict", "paper", "nan", "inf", "seed", "gaussian_noise", "dynamic",
    "ate_rmse_m",
)  # fmt: skip
RAWS = raws(*OF_NUMBERS, b'"', b"a,b", b"'")


@functools.cache
def _base():
    """Return a folder of results, made once in a process."""
    keeper = tempfile.TemporaryDirectory(prefix="results-")
    _KEPT.append(keeper)
    folder = Path(keeper.name) / "results"
    make_results(folder, **FEW)
    for path in folder.rglob("run.json"):  # as a study writes them
        record = {"processor_s": None, "peak_memory_bytes": None, "exit_status": 0, **json.loads(path.read_text())}
        path.write_text(json.dumps(record))
    return folder


_KEPT = []


def write(folder, rng):
    """Write a folder of results and change one or two of its files."""
    (folder / "outside").mkdir()
    (folder / "outside/kept.txt").write_text("somebody's")
    out = folder / "out"
    shutil.copytree(_base(), out)
    told = []
    for _ in range(1 + int(rng.integers(4) == 0)):
        top = [out / "study.json", *sorted((out / "tables").iterdir())] * 6
        rest = [path for path in sorted(out.rglob("*")) if path.suffix in (".json", ".csv", ".txt")]
        told += _text_changed(pick(rng, top + rest), rng)
    (folder / TASK).write_text(json.dumps(pick(rng, ("read", "read", "tables"))))
    note(folder, told)


def _text_changed(path, rng):
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix == ".json":
        try:
            tree, told = changed(json.loads(text), rng, words=WORDS)
        except (ValueError, RecursionError):  # changed before
            return ["is no JSON any more"]
        data = as_json(tree, indent=1)
    else:
        separator = "," if path.suffix == ".csv" else " "
        rows = [line.split(separator) for line in text.splitlines()]
        tree, told = changed(rows, rng, raws=RAWS, words=WORDS)
        data = as_table(tree, separator)
    if told:
        path.write_bytes(data)
    return [f"{path.name}: {each}" for each in told]


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
        run_pictures._path(found, pick_, missing)
    for runs in picked_sequences(found):
        run_pictures._times(found, runs, missing)
    run_pictures.worst_frames(found, missing)
    told = [evaluated.opening(found), *evaluated.facts(found), evaluated.again(found), evaluated.command(found)]
    assert told
    assert all(line.isprintable() for line in missing)


def differs(folder, meaning, peer=None):
    """Say nothing: what a changed number means is that number."""
    del folder, meaning, peer
    return ""
