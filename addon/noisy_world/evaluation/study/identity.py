# SPDX-License-Identifier: GPL-3.0-or-later
"""`study.json`: what a folder of results evaluates. A study grows by scenes, settings, systems, seeds and repeats."""

from typing import Any

from ...core.datasets.differences import first_difference
from ...core.datasets.identity_mismatch import decisive
from ...core.datasets.provenance import HUFFMAN
from ...core.errors import StorageError
from .results import STUDY, ResultsFolder
from .written import ANOTHER, FORMAT, KIND, read_study

BY_NAME = ("scenes", "settings", "sequences", "found")
"""Parts of what the sequences are made from that hold something for each name: others are added."""
FOR_PEOPLE = ("preset", "preset_sha256")
"""Parts that decide nothing which other parts do not tell."""
EXPECTED = "expects_clean"
"""What a system's runs are held against, which may be said anew of runs that are there."""


def write_study_identity(results: ResultsFolder, identity: dict[str, Any], *, seeds: list[int], repeats: int) -> None:
    """Write what is evaluated, beside what was before in the same folder.

    Raises StorageError where the folder holds a study of something else, in a line that names the first difference.
    """
    path = results.folder / STUDY
    here = {**identity, "seeds": sorted(seeds), "repeats": repeats}
    if path.is_file():
        there = read_study(results)
        if problem := why_not(there, here):
            raise StorageError(f"holds another study: {problem}", file=results.folder, remedy=ANOTHER)
        here = merged(there, here)
    elif results.folder.is_dir() and any(item.name != results.work.name for item in results.folder.iterdir()):
        raise StorageError("is not empty and holds no study", file=results.folder, remedy=ANOTHER)
    results.write_json(path, {"kind": KIND, "format": FORMAT, "study": here})


def why_not(there: dict[str, Any], here: dict[str, Any]) -> str:
    """Return the first difference of two studies in what both name, or ""."""
    if found := _run_or_scored_otherwise(there, here):
        return found
    before, now = there["subject"], here["subject"]
    if of_any_processor(before) and of_any_processor(now):
        before, now = decisive(before), decisive(now)
    for key in sorted({*before, *now} - set(FOR_PEOPLE)):
        left, right = before.get(key), now.get(key)
        if key in BY_NAME and isinstance(left, dict) and isinstance(right, dict):
            both = [name for name in left if name in right]
            left, right = ({name: part[name] for name in both} for part in (left, right))
        if key == "output":  # systems read the same pixels
            left, right = ({**(part or {}), HUFFMAN: None} for part in (left, right))
        if found := first_difference(left, right, key):
            return found
    return ""


def _run_or_scored_otherwise(there: dict[str, Any], here: dict[str, Any]) -> str:
    """Return the first difference of two studies in their systems, metrics and protocol, or ""."""
    for name in sorted(there["systems"].keys() & here["systems"].keys()):
        if _deciding(there["systems"][name]) != _deciding(here["systems"][name]):
            return f"the definition of {name} is another"
    before, now = there.get("metrics", {}), here.get("metrics", {})
    for name in sorted(before):
        if name in now and before[name] != now[name]:
            return f"the metric {name} is of {before[name]}, and here of {now[name]}"
    if there.get("definitions", 1) != here.get("definitions", 1):
        return "its runs were scored by other definitions of pairing, coverage and rotation"
    for key in ("protocol", "maps"):
        if there.get(key) != here[key]:
            return first_difference(there.get(key), here[key], key) or ""
    return ""


def of_any_processor(subject: dict[str, Any]) -> bool:
    """Tell whether the preset allows frames of unlike processors: `render.processors: any`."""
    render = subject["preset"].get("render") if isinstance(subject.get("preset"), dict) else None
    return isinstance(render, dict) and render.get("processors") == "any"


def _deciding(definition: Any) -> Any:
    """Return what is said of a system's definition without what its runs are held against."""
    if not isinstance(definition, dict):
        return definition
    return {key: value for key, value in definition.items() if key != EXPECTED}


def merged(there: dict[str, Any], here: dict[str, Any]) -> dict[str, Any]:
    """Return what a folder evaluates that held `there` and takes `here`."""
    before, now = there["subject"], here["subject"]
    subject = {
        key: {**before.get(key, {}), **value} if key in BY_NAME and isinstance(value, dict) else value
        for key, value in now.items()
    }
    brought = {**there.get("metrics", {}), **here.get("metrics", {})}
    return {
        **here,
        **({"metrics": brought} if brought else {}),
        "subject": subject,
        "systems": {**there["systems"], **here["systems"]},
        "seeds": sorted({*there["seeds"], *here["seeds"]}),
        "repeats": max(there["repeats"], here["repeats"]),
    }
