# SPDX-License-Identifier: GPL-3.0-or-later
"""`list`, `status`: what a preset may say, what it holds, and how far its dataset has come."""

import argparse
import json
import re
import shutil
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.progress import SilentProgress, duration_text
from ..core.schema import list_keys, yaml_line
from .arguments import Parser, add_part_options, frame_slice, part_words, place, shipped_presets
from .command import Command, run
from .entry import Entry, text_listener

if TYPE_CHECKING:
    from ..dataset.plan import Plan, Render
    from ..dataset.status import Pace, SequenceStatus, Status


HELD = ("scenes", "settings", "sequences")  # what a preset holds
MOST_RENDERS = 20  # that a dry run lists one by one
MOST_SETTINGS = 12  # of a render that it names


def list_presets() -> None:
    """List the presets that are shipped."""
    for name in shipped_presets():
        print(name)


def list_preset_keys() -> None:
    """List every key that a preset may have, with its meaning, unit, range and default."""
    from ..sources import preset_keys

    rows = dict(preset_keys())
    width = max(map(len, rows))
    for name, meaning in rows.items():
        print(f"{name:<{width}}  {meaning}")


def list_sources() -> None:
    """List where a preset's scenes may come from, and the keys of each: its own, and whether it has a trajectory."""
    from ..sources import SOURCES

    for name, kind in SOURCES.items():
        print(f"{name}  {kind.label}: {kind.meaning}{SOURCES.origin(name)}")
        rows = [row for row in list_keys(kind.keys) if row[0] != "name" and not row[0].startswith("trajectory.")]
        for key, meaning in sorted(rows, key=lambda row: row[0].partition(".")[0] != name):
            print(f"    {key}: {meaning}")


def list_channels() -> None:
    """List what a camera gives for a frame, and how its files hold it."""
    from ..channels import CHANNELS

    width = max(map(len, CHANNELS))
    for name, item in CHANNELS.items():
        print(f"{name:<{width}}  {item.meaning}: {item.convention}{CHANNELS.origin(name)}")


def list_cameras() -> None:
    """List the real cameras that a preset may name as `device`: what they stand for, and where the figures are from."""
    from ..preset.camera_devices import CAMERA_DEVICES

    for name, device in CAMERA_DEVICES.items():
        print(f"{name}  {device.label}: {device.meaning}{CAMERA_DEVICES.origin(name)}")
        print(f"    camera: {yaml_line(device.camera)}")
        print(f"        {device.sources['lens']}")
        for step, values in device.steps.items():
            print(f"    {step}: {yaml_line(dict(values))}")
            print(f"        {device.sources[step]}")


def list_layouts() -> None:
    """List every layout with its image kinds, its colours (the default of each first) and its depth scale.

    Then those of recordings that are read alone, and the files that each is told by.
    """
    from ..layouts import EVERY, LAYOUTS, RECORDED
    from ..preset.keys import OutputSpec

    for layout in LAYOUTS.values():
        print(f"{layout.name}  {layout.label}, {layout.meaning}{EVERY.origin(layout.name)}")
        print(f"    images {' or '.join(layout.images)}; colour {' or '.join(layout.colours)}")
        farthest_m = OutputSpec(layout=layout.name).format.depth_limit_m
        print(f"    depth in 16 bits, {layout.depth_scale_per_m:g} steps a metre: up to {farthest_m:.1f} m")
    print("\nread alone, as sequence: FOLDER")
    for layout in RECORDED.values():
        print(f"{layout.name}  {layout.label}: {layout.meaning}{EVERY.origin(layout.name)}")
        print(f"    {layout.files}")


def list_trajectory_formats() -> None:
    """List the formats of files of poses, and how the content of a file tells each."""
    from ..trajectories.formats import TRAJECTORY_FORMATS

    for name, item in TRAJECTORY_FORMATS.items():
        print(f"{name}  {item.label}: {item.meaning}{TRAJECTORY_FORMATS.origin(name)}")
        print(f"    told by {item.recognised_by}; times: {item.times}")


def list_metrics() -> None:
    """List every metric, of paths by protocol strict and of maps: name, heading, unit, which way is better, meaning."""
    from ..evaluate.map_metrics import MAP_METRICS, MAP_PREFIX
    from ..evaluate.metrics import METRICS

    for prefix, metrics in (("", METRICS), (MAP_PREFIX, MAP_METRICS)):
        for name, metric in metrics.items():
            unit = f" [{metric.unit}]" if metric.unit else ""
            better = f", {metric.better} is better" if metric.better else ""
            print(f"{prefix}{name}  {metric.label}{unit}{better}{metrics.origin(name)}")
            print(f"    {metric.meaning}")


def list_perturbations() -> None:
    """List every perturbation in the order of propagation, with its kind, stage, order and parameters.

    Parameters are listed with their ranges and their values at severities 1 to 5.
    """
    from ..perturbations import registry
    from ..perturbations.kinds import kind_name

    for item in registry().values():
        origin = f"; from {item.distribution}" if item.distribution else ""
        print(f"{item.name}  ({kind_name(item)}, stage {item.stage}, order {item.order}; {item.label}{origin})")
        for name, meaning in list_keys(item.parameters):
            levels = item.severities.get(name)
            at = f"; severities 1 to 5: {', '.join(f'{value:g}' for value in levels)}" if levels else ""
            print(f"    {name}: {meaning}{at}")


_LISTED = {
    "keys": list_preset_keys,
    "sources": list_sources,
    "layouts": list_layouts,
    "formats": list_trajectory_formats,
    "channels": list_channels,
    "cameras": list_cameras,
    "metrics": list_metrics,
    "perturbations": list_perturbations,
    "presets": list_presets,
}
KNOWN = tuple(_LISTED)
"""What can be listed without a preset."""


def list_known(what: str) -> int:
    """List what does not depend on a preset, one of KNOWN."""
    _LISTED[what]()
    return 0


def list_plan(plan: "Plan", what: str) -> int:
    """List what a preset holds."""
    if what == "scenes":
        for render in plan.renders:
            print(f"{render.name}  {len(render.frames)} frames  {render.scene.source.location}")
    elif what == "settings":
        for setting in plan.settings:
            print(setting.name)
    else:
        for sequence in plan.sequences:
            print(sequence.folder)
    return 0


def print_plan(plan: "Plan", out: Path | str) -> None:
    """Print what a run would do."""
    from ..core.machine import free_memory_bytes
    from ..dataset.estimate import estimate, memory_bytes, size_text
    from ..dataset.plan import plan_notes
    from ..measure.looking import remarks_on

    guess = estimate(plan)
    print(f"preset     {plan.preset.path} (SHA-256 {plan.preset.sha256[:12]})")
    print(f"dataset    {out} ({plan.format.layout.name} layout, {plan.format.image} and 16-bit png)")
    cameras = plan.cameras if plan.camera is None else {"": plan.camera}
    for scene, camera in cameras.items():
        whose = f"{scene}: " if scene else ""
        print(f"camera     {whose}{camera.width_px} x {camera.height_px}, fx {camera.fx_px:g}, fy {camera.fy_px:g}")
    if plan.format.note:
        print(f"note       {plan.format.note}")
    for text in plan_notes(plan):
        print(f"note       {text}")
    for scene in plan.scenes:
        for text in remarks_on(scene.source, plan.cameras[scene.name], 0):
            print(f"note       {scene.name}: {text}")
    print(f"sequences  {len(plan.sequences)} ({counted(plan.scenes, 'scene')}, {counted(plan.settings, 'setting')})")
    for line in render_lines(plan):
        print(f"  {line}")
    print(f"renders    {len(plan.renders)}, {plan.frame_count} frames in all")
    between = f"{size_text(guess.least_bytes)} to {size_text(guess.most_bytes)}, by what the images show"
    took = duration_text(guess.seconds)
    print(f"estimate   {size_text(guess.bytes_written)} ({between}), {took} on two cores (rough)")
    free = free_memory_bytes()
    here = "" if free is None else f"; {size_text(free)} are free here"
    print(f"memory     {size_text(memory_bytes(plan))} or more in each process, and what the scenes take{here}")


def counted(things: Sequence[object], name: str) -> str:
    """Return a number of things in words."""
    return f"{len(things)} {name}{'' if len(things) == 1 else 's'}"


def render_lines(plan: "Plan") -> Iterator[str]:
    """Yield a line for each render; where there are many, one for all of a scene that move its path."""
    moved: dict[str, list[Render]] = {}
    grouped = len(plan.renders) > MOST_RENDERS
    for render in plan.renders:
        if grouped and render.moving:
            moved.setdefault(render.scene.name, []).append(render)
        else:
            settings = [sequence.setting.name for sequence in render.sequences]
            yield f"{render.name}: {len(render.frames)} frames, {enumerated(settings)}"
    for scene, renders in moved.items():
        settings = [sequence.setting.name for render in renders for sequence in render.sequences]
        frames = sum(len(render.frames) for render in renders)
        yield f"{scene}, {counted(renders, 'render')} along other paths: {frames} frames, {enumerated(settings)}"


def enumerated(settings: list[str]) -> str:
    """Return settings in words: all of a few, and of many the first ones, the last and how many they are."""
    if len(settings) <= MOST_SETTINGS:
        return f"settings {', '.join(settings)}"
    return f"{len(settings)} settings {', '.join(settings[:4])}, ... {settings[-1]}"


# --- `list` ---


def _list_options(parser: Parser) -> None:
    parser.option(
        "what WHAT",
        f"{', '.join(KNOWN)}: what there is; {', '.join(HELD)}: what a preset holds",
        choices=[*KNOWN, *HELD],
    )
    parser.option("preset PRESET", f"the preset, for {', '.join(HELD)}", nargs="?")
    add_part_options(parser)


def _settle_list(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if options.what in HELD and options.preset is None:
        parser.error(f"{options.what}: name a preset, presets/demo.yaml for instance")
    return options


def _list(options: argparse.Namespace, entry: Entry) -> int:
    named = [] if options.preset is None else [options.preset]
    return run("generate", [*named, "--list", options.what, *part_words(options)], entry)


LIST = Command(
    name="list",
    order=50,
    group="look at what there is",
    help="list what a preset may say and what is shipped, or what a preset holds",
    description="List the keys of presets, or what a preset holds.",
    options=_list_options,
    settle=_settle_list,
    run=_list,
    needs=(),
)


# --- `status` ---


LONGEST_TABLE = 40  # rows; with more settings than that, the severities of one share a row
NAMED = 5  # files that are named of those that are lost or damaged; --json names all


def format_status(status: "Status", *, every_setting: bool = False) -> str:
    """Return a status as text. every_setting: each setting has a row of its own, however many there are."""
    lines = [_summary(status), "", *_table(status.sequences, every_setting), ""]
    lines += [*status.notes]
    for what, names in (("lost", status.lost), ("damaged", status.damaged)):
        if names:
            more = f" and {len(names) - NAMED:,} more" if len(names) > NAMED else ""
            lines.append(f"{what:<8} {_count(len(names), 'file')}: {', '.join(names[:NAMED])}{more}")
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
    parts = f"{_count(settings, 'setting')}, {_count(scenes, 'scene')}, {_count(len(status.sequences), 'sequence')}"
    total = "an unknown number of" if status.of is None else f"{status.of:,}"
    share = f" ({_percent(status.done, status.of)} %)" if status.of else ""
    end = "" if status.ended else "; its run has not come to its end"
    return f"{status.out}: {parts}, {status.done:,} of {total} frames{share}{end}"


def _percent(done: int, of: int) -> int:
    return 100 * done // of  # rounded down, so that 100 means all


def _count(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"


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


def _of_pace(pace: "Pace") -> str:
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
    from ..dataset.status import read_status

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

COMMAND = LIST, STATUS
