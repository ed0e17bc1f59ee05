# SPDX-License-Identifier: GPL-3.0-or-later
"""What was evaluated, and how to get it again: from study.json, the tables, and what single runs recorded."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from ..metrics import PROTOCOLS
from .reading import KEY, Results, read_object, records

LONGEST_LIST = 12
TOLD = ("systems", "protocol", "repeats", "seeds")  # keys of study.json that are told in words


def opening(results: Results) -> str:
    """Return the report's first sentence."""
    runs, systems = results.runs, results.runs["system"].nunique()
    sequences = runs.drop_duplicates(list(KEY))
    return (
        f"{_count(len(runs), 'run')} of {_count(systems, 'system')} on {_count(len(sequences), 'sequence')} "
        f"({_count(runs['scene'].nunique(), 'scene')}, {_count(runs['setting'].nunique(), 'setting')}); "
        f"{int(runs['failed'].sum())} of them failed. A failed run is counted as such, and is in no mean of an error."
    )


def facts(results: Results) -> list[tuple[str, str]]:
    """Return what was evaluated, as labels and texts."""
    runs = results.runs
    found = [(f"system {system}", _system(results, str(system))) for system in sorted(set(runs["system"]))]
    found.append(("scenes", _listed(sorted(set(runs["scene"])))))
    found.append(("settings", _listed(list(dict.fromkeys(results.sequences["setting"])))))
    found.append(("seeds", _listed(sorted(set(runs["seed"]), key=lambda seed: seed.zfill(20)))))
    frames = results.sequences["frames"] if "frames" in results.sequences else runs.get("frames")
    if frames is not None and frames.notna().any():
        least, most = int(frames.min()), int(frames.max())
        found.append(("frames of a sequence", str(least) if least == most else f"{least} to {most}"))
    protocol = results.study.get("protocol")
    if isinstance(protocol, str) and protocol in PROTOCOLS:
        found.append(("protocol", f"{protocol}: {PROTOCOLS[protocol].meaning}"))
        found.append(("stamps", f"poses belong together within {PROTOCOLS[protocol].max_difference_s:g} s"))
    if any(str(name).startswith("paper.") for name in runs.columns):
        faults = "; ".join(said for _, said in PROTOCOLS["paper"].faults)
        found.append(("columns paper.", f"as the published code does it: {faults}"))
    if "processor_s" in runs and runs["processor_s"].notna().any():
        found.append(("processor time of the systems", f"{runs['processor_s'].sum() / 3600:.3g} h"))
    return found + _of_study(results.study)


def again(results: Results) -> list[str]:
    """Return how to get the report and the results again, in sentences."""
    said = ["The report is made anew, from what is in the folder, by: noisy-world report RESULTS."]
    if results.study:
        said.append("study.json holds everything that decides the results; another run into the folder has to agree with it.")
    return said


def command(results: Results) -> str:
    """Return the command that made the results, if study.json has it."""
    given = results.study.get("command")
    if isinstance(given, str):
        return given
    return " ".join(map(str, given)) if isinstance(given, list) else ""


def _system(results: Results, system: str) -> str:
    runs = results.runs[results.runs["system"] == system]
    said = [_count(len(runs), "run"), f"{int(runs['failed'].sum())} failed"]
    repeats = int(runs["repeat"].nunique())
    said.append(f"{repeats} repeats, as its results differ from run to run" if repeats > 1 else "one repeat")
    versions: dict[str, set[str]] = {}
    for run in records(runs.drop_duplicates("setting").head(LONGEST_LIST)):
        path = results.run_folder(run) / "run.json"
        told = read_object(path).get("versions") if path.is_file() else None
        for name, version in (told if isinstance(told, Mapping) else {}).items():
            versions.setdefault(str(name), set()).add(str(version))
    if versions:
        said.append(", ".join(f"{name} {' and '.join(sorted(versions[name]))}" for name in sorted(versions)))
    told = results.study.get("systems")
    definition = told.get(system) if isinstance(told, Mapping) else None
    if definition is not None:
        said.append(f"definition {_plain(definition)}")
    return "; ".join(said)


def _of_study(study: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the rest of study.json that is short enough to be read."""
    found = []
    for key in sorted(study):
        value = study[key]
        if key in TOLD or isinstance(value, (Mapping, list)):
            continue
        found.append((str(key).replace("_", " "), str(value)))
    return found


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, sort_keys=True, ensure_ascii=False)


def _listed(names: Iterable[Any]) -> str:
    every = [str(name) for name in names]
    more = f", ... ({len(every)} in all)" if len(every) > LONGEST_LIST else ""
    return ", ".join(every[:LONGEST_LIST]) + more


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
