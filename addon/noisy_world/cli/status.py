# SPDX-License-Identifier: GPL-3.0-or-later
"""`status`: how far a dataset has come, and what of it is missing or damaged."""

import argparse
import json
import re
import shutil
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from ..core.progress import SilentProgress, counted, duration_text
from .arguments import Parser, frame_slice, place
from .command import Command
from .entry import Entry, text_listener

if TYPE_CHECKING:
    from ..dataset.dataset_status import RunPace, SequenceStatus, Status


LONGEST_TABLE = 40  # rows; with more settings than that, the severities of one share a row
NAMED = 5  # files that are named of those that are lost or damaged; --json names all


def format_status(status: "Status", *, every_setting: bool = False) -> str:
    """Return a status as text. every_setting: each setting has a row of its own, however many there are."""
    lines = [_summary(status), "", *_table(status.sequences, every_setting), ""]
    lines += [*status.notes]
    for what, names in (("lost", status.lost), ("damaged", status.damaged)):
        if names:
            more = f" and {len(names) - NAMED:,} more" if len(names) > NAMED else ""
            lines.append(f"{what:<8} {counted(len(names), 'file')}: {', '.join(names[:NAMED])}{more}")
    if not (status.lost or status.damaged):
        checked = (
            "every file is as it was written"
            if status.checked
            else "none that was finished is lost; --check reads them all"
        )
        lines.append(f"files    {checked}")
    if shards := _shards(status):
        lines.append(f"shards   {shards}")
    lines.append(f"time     {_time(status)}")
    return "\n".join(lines)


def content(status: "Status") -> dict[str, Any]:
    """Return a status as JSON values."""
    return {
        "out": str(status.out),
        "whole": status.whole,
        "ended": status.ended,
        "checked": status.checked,
        "frames_done": status.done,
        "frames": status.of,
        "sequences": {
            f"{item.setting}/{item.scene}": {"frames_done": item.inventory.done, "frames": item.of}
            for item in status.sequences
        },
        "lost": list(status.lost),
        "damaged": list(status.damaged),
        "pace": asdict(status.pace) | {"silent": status.pace.silent},
        "total_s": status.total_s,
        "shards": {
            "merged": list(status.shards.merged),
            "finished": status.shards.finished,
            "unfinished": status.shards.unfinished,
        },
        "notes": list(status.notes),
    }


def _summary(status: "Status") -> str:
    settings = len({item.setting for item in status.sequences})
    scenes = len({item.scene for item in status.sequences})
    parts = f"{counted(settings, 'setting')}, {counted(scenes, 'scene')}, {counted(len(status.sequences), 'sequence')}"
    total = "an unknown number of" if status.of is None else f"{status.of:,}"
    share = f" ({_percent(status.done, status.of)} %)" if status.of else ""
    end = "" if status.ended else "; its run has not come to its end"
    return f"{status.out}: {parts}, {status.done:,} of {total} frames{share}{end}"


def _percent(done: int, of: int) -> int:
    return 100 * done // of  # rounded down, so that 100 means all


# --- the table ---


def _table(sequences: Iterable["SequenceStatus"], every_setting: bool) -> list[str]:
    """Return a row for each setting, or for those of one family, and a column for each scene."""
    items = list(sequences)
    names = list(dict.fromkeys(item.setting for item in items))
    grouped = len(names) > LONGEST_TABLE and not every_setting
    family = {name: family_of(name) if grouped else name for name in names}
    cells: dict[str, dict[str, list[SequenceStatus]]] = {}
    for item in items:
        cells.setdefault(family[item.setting], {}).setdefault(item.scene, []).append(item)
    counts = dict.fromkeys(cells, 0)
    for name in names:
        counts[family[name]] += 1
    labels = {row: row if counts[row] == 1 else f"{row} ({counts[row]})" for row in cells}
    scenes = list(dict.fromkeys(item.scene for item in items))
    return _laid_out(
        labels, {row: {scene: cell(found.get(scene, ())) for scene in scenes} for row, found in cells.items()}
    )


def family_of(setting: str) -> str:
    """Return a setting's name without severity and mode: fog for fog_s3_dynamic."""
    return re.sub(r"_s[0-9.]+(_dynamic)?$", "", setting)


def cell(items: Iterable["SequenceStatus"]) -> str:
    """Return how far sequences have come together: "done", "-", "812/2000"; with "!3" where three files are wrong."""
    found = list(items)
    if not found:
        return ""
    done = sum(item.inventory.done for item in found)
    wrong = sum(len(item.inventory.lost) + len(item.inventory.damaged) for item in found)
    of = "?" if any(item.of is None for item in found) else str(sum(item.of or 0 for item in found))
    text = "done" if all(item.whole for item in found) else "-" if not done else f"{done}/{of}"
    return f"{text} !{wrong}" if wrong else text


def _laid_out(labels: dict[str, str], cells: dict[str, dict[str, str]]) -> list[str]:
    """Return the lines of a table, its columns in blocks that fit the terminal."""
    first = max(len("setting"), *map(len, labels.values()))
    scenes = list(next(iter(cells.values())))
    widths = {scene: max(len(scene), *(len(row[scene]) for row in cells.values())) for scene in scenes}
    room = shutil.get_terminal_size((120, 0)).columns - first
    blocks: list[list[str]] = [[]]
    for scene in scenes:
        if blocks[-1] and sum(widths[name] + 2 for name in (*blocks[-1], scene)) > room:
            blocks.append([])
        blocks[-1].append(scene)
    lines: list[str] = []
    for block in blocks:
        lines += [""] if lines else []
        lines.append("  ".join([f"{'setting':<{first}}", *(f"{scene:>{widths[scene]}}" for scene in block)]))
        for row, label in labels.items():
            lines.append("  ".join([f"{label:<{first}}", *(f"{cells[row][name]:>{widths[name]}}" for name in block)]))
    return lines


def _shards(status: "Status") -> str:
    """Return what becomes of the shards; "" where there are none."""
    shards = status.shards
    parts = [f"{len(shards.merged):,} merged"] if shards.merged else []
    parts += [f"{len(shards.finished):,} finished and to be merged"] if shards.finished else []
    if shards.unfinished:
        name, last_s = max(shards.unfinished.items(), key=lambda item: item[1])
        ago = duration_text(max(0.0, time.time() - last_s))
        parts.append(f"{len(shards.unfinished):,} begun, of which {name} was written to {ago} ago")
    return ", ".join(parts)


# --- time ---


def _time(status: "Status") -> str:
    if status.ended:
        took = "" if status.total_s is None else f"; its last run took {duration_text(status.total_s)}"
        return f"the last run has come to its end{took}"
    return _of_pace(status.pace)


def _of_pace(pace: "RunPace") -> str:
    if pace.last_s is None:
        return "unknown: no frame is written yet"
    last = f"the last frame was written {duration_text(pace.last_s)} ago"
    if pace.frames_per_s is None:
        return f"{last}; time left unknown: too few frames are written to tell the pace"
    rate = f"{pace.frames_per_s:.3g} frames/s over {duration_text(pace.window_s)}"
    left = "time left unknown" if pace.left_s is None else f"about {duration_text(pace.left_s)} left"
    if pace.silent:
        return f"{last}, so no run seems to go on; {left} at the pace before that, {rate}"
    return f"{left} at the present pace, {rate}; {last}"


# --- `status` ---


def _status_options(parser: Parser) -> None:
    parser.option("out OUT", "the dataset's folder or address", type=place)
    parser.flag("--check", "read every file and compare its SHA-256")
    parser.option("--frames A:B", "ask for frames A to B-1 of each path alone", type=frame_slice)
    parser.flag(
        "--all", f"a row for each setting, also where there are more than {LONGEST_TABLE}; else severities share a row"
    )
    parser.flag("--json", "print one JSON object instead")


def _tell_status(options: argparse.Namespace, _: Entry) -> int:
    """Print it; return 0, or 1 where files are lost or damaged."""
    from ..dataset.dataset_status import read_status

    listener = text_listener(sys.stderr) if options.check else SilentProgress()  # without it, looking takes seconds
    status = read_status(options.out, listener, chosen=options.frames, check=options.check)
    print(json.dumps(content(status), indent=1) if options.json else format_status(status, every_setting=options.all))
    return 1 if status.lost or status.damaged else 0


STATUS = Command(
    name="status",
    order=60,
    group="look at what there is",
    help="say how far a dataset has come, and what of it is missing or damaged",
    description="Say how far a dataset has come, while a run makes it or after that: a table of settings and "
    "scenes, what is lost or damaged, and how long the rest takes at the present pace. Nothing is changed.",
    options=_status_options,
    run=_tell_status,
)

COMMAND = STATUS
