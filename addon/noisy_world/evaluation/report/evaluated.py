# SPDX-License-Identifier: GPL-3.0-or-later
"""What was evaluated, and how to get it again: from study.json, the tables, and what single runs recorded."""

import hashlib
import json
import shlex
from collections.abc import Iterable, Mapping
from typing import Any

from ...core.errors import one_line
from ..analysis.run_table import SUCCESS, SUCCESS_OVER_CLEAN
from ..metrics import PROTOCOLS
from ..metrics.alignment import CONDITIONING, WELL_CONDITIONED
from ..metrics.rotation_order import WRONG_DEG
from ..metrics.success import IS_INCOMPLETE, LEAST_TRACKED
from ..study.cases import CLEAN
from ..study.record import VERSIONS
from .labels import column_of
from .reading import KEY, Results, read_object, records

LONGEST_LIST = 12
ROTATION = "ate_rotation_median_deg"


def opening(results: Results) -> str:
    """Return the report's first sentence."""
    runs, systems = results.runs, results.runs["system"].nunique()
    sequences = runs.drop_duplicates(list(KEY))
    said = (
        f"{_count(len(runs), 'run')} of {_count(systems, 'system')} on {_count(len(sequences), 'sequence')} "
        f"({_count(runs['scene'].nunique(), 'scene')}, {_count(runs['setting'].nunique(), 'setting')}); "
        f"{int(runs['failed'].sum())} of them failed: they gave no estimate, or one that cannot be scored. "
        f"{int(runs['incomplete'].sum())} are incomplete: they {IS_INCOMPLETE}. Both are counted, and are in no mean, "
        "median or ratio of an error: that of an incomplete run is of the frames that it did not give up. It stands in "
        "the table of single runs alone. Means of errors are geometric."
    )
    if SUCCESS in runs:
        successes = int((runs[SUCCESS] == 1.0).sum())
        meaning = f"an ATE below that, with {100 * LEAST_TRACKED:g} % of the frames tracked"
        said += f" {successes} had {column_of(SUCCESS).label}: {meaning}."
    if SUCCESS_OVER_CLEAN in runs:
        noisy = runs[(runs["perturbation"] != CLEAN) & runs[SUCCESS_OVER_CLEAN].notna()]
        if len(noisy):
            successes = int((noisy[SUCCESS_OVER_CLEAN] == 1.0).sum())
            said += (
                f" Of the {len(noisy)} perturbed runs that have a clean one beside them, {successes} had "
                f"{column_of(SUCCESS_OVER_CLEAN).label}: an ATE below ten times the clean one."
            )
    return said + _turned(results) + _nearly_straight(results)


def _nearly_straight(results: Results) -> str:
    """Return a sentence that marks the scenes whose paths do not say how an estimate is turned; "" for none.

    By the clean runs, or by all where there is none; nothing is said of results whose runs have no such column.
    """
    runs = results.complete
    if CONDITIONING not in runs:
        return ""
    clean = runs[runs["perturbation"] == CLEAN]
    known = (clean if len(clean) else runs).dropna(subset=[CONDITIONING])
    least = known.groupby("scene", sort=True)[CONDITIONING].median()
    marked = [f"{scene} ({ratio:.2g})" for scene, ratio in least.items() if ratio < WELL_CONDITIONED]
    if not marked:
        return ""
    return (
        f" The path does not say how an estimate is turned about itself in {_listed(marked)}: its second extent is so "
        f"many ATEs of clean runs (median), below {WELL_CONDITIONED:g}. Full poses lay rotations and maps there."
    )


def _turned(results: Results) -> str:
    """Return a sentence on each system whose positions are right where its rotations are not; "" for none.

    Nothing is said of results without the column of the conditioning: their rotations were laid by positions alone.
    """
    runs = results.complete
    if SUCCESS not in runs or ROTATION not in runs or CONDITIONING not in runs:
        return ""
    turned = runs[(runs[SUCCESS] == 1.0) & (runs[ROTATION] > WRONG_DEG)]
    return "".join(
        f" In {_count(len(group), 'run')} of {system} the positions are right and the rotations off by more than "
        f"{WRONG_DEG:g} degrees, as where quaternions are written w first and read as x y z w, or where the camera's "
        "axes are others."
        for system, group in turned.groupby("system", sort=True)
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
    return found + _subject(results.study.get("subject"))


def again(results: Results) -> list[str]:
    """Return how to get the report and the results again, in sentences."""
    said = ["From what is in the folder, 'noisy-world report FOLDER' writes this report anew, to the same bytes."]
    if results.study:
        said.append(
            "study.json holds everything that decides the results, the preset among it; 'noisy-world evaluate PRESET "
            "--systems ... --out FOLDER' makes them, and what differs from study.json is refused."
        )
    return said


def command(results: Results) -> str:
    """Return the command that makes the results: the preset's document has to stand in a file; "" if it is unknown."""
    study = results.study
    if not study:
        return ""
    systems = ",".join(sorted(set(results.runs["system"])))
    words = [f"noisy-world evaluate PRESET --systems {shlex.quote(systems)}"]
    seeds = study.get("seeds")
    if isinstance(seeds, list) and seeds:
        words.append(f"--seeds {shlex.quote(','.join(map(str, seeds)))}")
    if isinstance(study.get("repeats"), int):
        words.append(f"--repeats {study['repeats']}")
    if isinstance(study.get("protocol"), str):
        words.append(f"--protocol {shlex.quote(study['protocol'])}")
    return one_line(" ".join([*words, "--out FOLDER"]))


def _system(results: Results, system: str) -> str:
    runs = results.runs[results.runs["system"] == system]
    said = [_count(len(runs), "run"), f"{int(runs['failed'].sum())} failed"]
    said.append(f"{int(runs['incomplete'].sum())} incomplete")
    repeats = int(runs["repeat"].nunique())
    said.append(f"{repeats} repeats, as its results differ from run to run" if repeats > 1 else "one repeat")
    of_record = results.study.get(VERSIONS)
    told = of_record.get(system) if isinstance(of_record, Mapping) else None
    versions = {str(name): {str(version)} for name, version in (told if isinstance(told, Mapping) else {}).items()}
    for run in records(runs.drop_duplicates("setting").head(LONGEST_LIST)):
        path = results.run_folder(run) / "run.json"
        systems = read_object(path).get("versions") if path.is_file() else None
        for name, version in (systems if isinstance(systems, Mapping) else {}).items():
            versions.setdefault(str(name), set()).add(str(version))
    if versions:
        said.append(", ".join(f"{name} {' and '.join(sorted(versions[name]))}" for name in sorted(versions)))
    systems = results.study.get("systems")
    definition = systems.get(system) if isinstance(systems, Mapping) else None
    if definition is not None:
        said.append(f"definition {_digest(definition)}")
    return "; ".join(said)


def _subject(subject: Any) -> list[tuple[str, str]]:
    """Return what the sequences were made from, as far as it is short enough to be read: study.json has all."""
    if not isinstance(subject, Mapping):
        return []
    found = []
    for key in ("preset_sha256", "seed", "render", "output", "versions"):
        value = subject.get(key)
        if isinstance(value, Mapping):
            value = ", ".join(f"{name} {_plain(value[name])}" for name in sorted(value) if value[name] is not None)
        if value is not None:
            found.append(
                (f"preset's {key}" if key in ("seed", "render", "output") else key.replace("_", " "), str(value))
            )
    return found


def _digest(definition: Any) -> str:
    """Return a definition's digest as study.json has it; of one that stands there whole, the digest of that."""
    if isinstance(definition, str):
        return definition[:16]
    return hashlib.sha256(_plain(definition).encode()).hexdigest()[:16]


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, sort_keys=True, ensure_ascii=False)


def _listed(names: Iterable[Any]) -> str:
    every = [str(name) for name in names]
    more = f", ... ({len(every)} in all)" if len(every) > LONGEST_LIST else ""
    return ", ".join(every[:LONGEST_LIST]) + more


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
