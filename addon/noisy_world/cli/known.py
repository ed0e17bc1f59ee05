# SPDX-License-Identifier: GPL-3.0-or-later
"""`list`, `describe`: what a preset may say and what is shipped, a line each, or one thing whole."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import InputError, did_you_mean
from ..core.file_access import read_text
from ..core.packages import PACKAGE, checkout
from ..core.schema import list_keys, yaml_line
from .arguments import Parser, add_part_options, part_words, shipped_presets
from .command import COMMANDS, Command, run
from .entry import Entry
from .plan_text import HELD

if TYPE_CHECKING:
    from ..perturbations.kinds import Perturbation


@dataclass(frozen=True)
class KnownThing:
    """A thing that is known: its name, the line that `list` has for it, and the lines that `describe` adds."""

    name: str
    line: str
    more: tuple[str, ...] = ()


def presets() -> Iterator[KnownThing]:
    """Yield the presets that are shipped, with the comment that each begins with."""
    for name, file in shipped_presets().items():
        head = read_text(file).splitlines()[0]
        yield KnownThing(name, head.lstrip("# ") if head.startswith("#") else "", (f"file {file}",))


def preset_keys() -> Iterator[KnownThing]:
    """Yield every key that a preset may have, with its meaning, unit, range and default."""
    from ..sources import preset_keys as rows

    yield from (KnownThing(name, meaning) for name, meaning in rows())


def sources() -> Iterator[KnownThing]:
    """Yield where a preset's scenes may come from, and the keys of each: its own, and whether it has a trajectory."""
    from ..sources import SOURCES

    for name, kind in SOURCES.items():
        keys = [row for row in list_keys(kind.keys) if row[0] != "name" and not row[0].startswith("trajectory.")]
        keys.sort(key=lambda row: row[0].partition(".")[0] != name)
        more = tuple(f"{key}: {meaning}" for key, meaning in keys)
        yield KnownThing(name, f"{kind.label}: {kind.meaning}{SOURCES.origin(name)}", more)


def channels() -> Iterator[KnownThing]:
    """Yield what a camera gives for a frame, and how its files hold it."""
    from ..channels import CHANNELS

    for name, item in CHANNELS.items():
        yield KnownThing(name, f"{item.meaning}: {item.convention}{CHANNELS.origin(name)}")


def cameras() -> Iterator[KnownThing]:
    """Yield the real cameras that a preset may name as `device`: what they stand for, and their figures' sources."""
    from ..preset.camera_devices import CAMERA_DEVICES

    for name, device in CAMERA_DEVICES.items():
        more = [f"camera: {yaml_line(device.camera)}", f"    {device.sources['lens']}"]
        for step, values in device.steps.items():
            more += [f"{step}: {yaml_line(dict(values))}", f"    {device.sources[step]}"]
        more += _pictures(f"panel/cameras/{name}.jpg")
        yield KnownThing(name, f"{device.label}: {device.meaning}{CAMERA_DEVICES.origin(name)}", tuple(more))


def layouts() -> Iterator[KnownThing]:
    """Yield every layout with its image kinds, its colours (the default of each first) and its depth scale.

    Then those of recordings that are read alone, and the files that each is told by.
    """
    from ..layouts import EVERY, LAYOUTS, RECORDED
    from ..preset.keys import OutputSpec

    for layout in LAYOUTS.values():
        farthest_m = OutputSpec(layout=layout.name).format.depth_limit_m
        more = (
            f"images {' or '.join(layout.images)}; colour {' or '.join(layout.colours)}",
            f"depth in 16 bits, {layout.depth_scale_per_m:g} steps a metre: up to {farthest_m:.1f} m",
        )
        yield KnownThing(layout.name, f"{layout.label}, {layout.meaning}{EVERY.origin(layout.name)}", more)
    for layout in RECORDED.values():
        line = f"{layout.label}: {layout.meaning}; only read, as sequence: FOLDER{EVERY.origin(layout.name)}"
        yield KnownThing(layout.name, line, (layout.files,))


def trajectory_formats() -> Iterator[KnownThing]:
    """Yield the formats of files of poses, and how the content of a file tells each."""
    from ..trajectories.formats import TRAJECTORY_FORMATS

    for name, item in TRAJECTORY_FORMATS.items():
        more = (f"told by {item.recognised_by}; times: {item.times}",)
        yield KnownThing(name, f"{item.label}: {item.meaning}{TRAJECTORY_FORMATS.origin(name)}", more)


def metrics() -> Iterator[KnownThing]:
    """Yield every metric, of paths by protocol strict and of maps: heading, unit, which way is better, meaning."""
    from ..evaluate.map_metrics import MAP_METRICS, MAP_PREFIX
    from ..evaluate.metrics import METRICS

    for prefix, items in (("", METRICS), (MAP_PREFIX, MAP_METRICS)):
        for name, metric in items.items():
            unit = f" [{metric.unit}]" if metric.unit else ""
            better = f", {metric.better} is better" if metric.better else ""
            yield KnownThing(f"{prefix}{name}", f"{metric.label}{unit}{better}{items.origin(name)}", (metric.meaning,))


def perturbations() -> Iterator[KnownThing]:
    """Yield every perturbation in the order of propagation, with its parameters, also at severities 1 to 5."""
    from ..perturbations import registry
    from ..perturbations.kinds import kind_name

    for item in registry().values():
        origin = f"; from {item.distribution}" if item.distribution else ""
        line = f"{item.label}: {item.sentence}{origin}"
        place = f"{kind_name(item)}, stage {item.stage}, order {item.order}"
        law = (item.about.law,) if item.about.law else ()
        pictures = _pictures(f"panel/thumbnails/perturbations/{item.name}.jpg", f"docs/gallery/{item.name}.jpg")
        yield KnownThing(item.name, line, (place, *law, *_parameters(item), *pictures))


def _parameters(item: "Perturbation") -> Iterator[str]:
    for name, meaning in list_keys(item.parameters):
        levels = item.severities.get(name)
        at = f"; severities 1 to 5: {', '.join(f'{value:g}' for value in levels)}" if levels else ""
        yield f"{name}: {meaning}{at}"


def _pictures(shipped: str, drawn: str = "") -> tuple[str, ...]:
    """Return where a picture lies: the checkout's large one, else the small one of the package; nothing without."""
    top = checkout()
    places = [top / drawn] if top is not None and drawn else []
    found = next((place for place in [*places, PACKAGE / shipped] if place.is_file()), None)
    return () if found is None else (f"picture {found}",)


def systems() -> Iterator[KnownThing]:
    """Yield the SLAM systems that are known; `noisy-world systems` tells which of them can be run here."""
    from ..evaluate.systems import distribution_of, find_system, system_names

    for name in system_names():
        origin = f"; from {brought}" if (brought := distribution_of(name)) else ""
        yield KnownThing(name, f"{find_system(name).about}{origin}")


KNOWN: Mapping[str, Callable[[], Iterable[KnownThing]]] = {
    "keys": preset_keys,
    "sources": sources,
    "layouts": layouts,
    "formats": trajectory_formats,
    "channels": channels,
    "cameras": cameras,
    "metrics": metrics,
    "perturbations": perturbations,
    "systems": systems,
    "presets": presets,
}
"""What can be listed without a preset."""

ONE = {what: what.removesuffix("s") for what in KNOWN}


def list_known(what: str, names: Iterable[str] = ()) -> int:
    """List what does not depend on a preset, one of KNOWN, a line each. names: only these, whole; of keys a branch.

    Raises InputError for a name that is none.
    """
    rows = {row.name: row for row in KNOWN[what]()}
    chosen = [row for name in names for row in _named(what, rows, name)]
    if chosen and what != "keys":
        print_whole(chosen)
    else:
        print_lines(chosen or rows.values())
    return 0


def _named(what: str, rows: Mapping[str, KnownThing], name: str) -> list[KnownThing]:
    branch = [row for row in rows.values() if what == "keys" and _below(row.name, name)]
    found = [rows[name]] if name in rows and not branch else branch
    if not found:
        asked = did_you_mean(name, rows)
        raise InputError(name, f"no such {ONE[what]}", remedy=asked or f"'noisy-world list {what}' names them")
    return found


def _below(key: str, branch: str) -> bool:
    """Tell whether a key is this one, or one inside it: scenes[].mesh is inside scenes."""
    return key == branch or key.startswith((f"{branch}.", f"{branch}["))


def print_lines(rows: Iterable[KnownThing]) -> None:
    """Print a line for each."""
    rows = list(rows)
    width = max(len(row.name) for row in rows)
    for row in rows:
        print(f"{row.name:<{width}}  {row.line}".rstrip())


def print_whole(rows: Iterable[KnownThing]) -> None:
    """Print all that is said of some things."""
    for row in rows:
        print(f"{row.name}  {row.line}".rstrip())
        for text in row.more:
            print(f"    {text}")


# --- `list` ---


def _list_options(parser: Parser) -> None:
    parser.option(
        "what WHAT",
        f"{', '.join(KNOWN)}: what there is; {', '.join(HELD)}: what a preset holds; none: how many there are of each",
        choices=[*KNOWN, *HELD],
        nargs="?",
    )
    parser.option("names NAME", f"only these, whole; for {', '.join(HELD)} the preset", nargs="*")
    add_part_options(parser)


def _settle_list(parser: Parser, options: argparse.Namespace) -> argparse.Namespace:
    if options.what in HELD and len(options.names) != 1:
        parser.error(f"{options.what}: name a preset, presets/demo.yaml for instance")
    if options.what not in HELD and part_words(options):
        parser.error(f"{part_words(options)[0]} is for {', '.join(HELD)}")
    return options


def _list(options: argparse.Namespace, entry: Entry) -> int:
    if options.what in HELD:
        return run("generate", [*options.names, "--list", options.what, *part_words(options)], entry)
    if options.what is None:
        print_lines(KnownThing(what, _counted(list(rows()))) for what, rows in KNOWN.items())
        return 0
    return list_known(options.what, options.names)


def _counted(rows: list[KnownThing]) -> str:
    return f"{len(rows)}, such as {', '.join(row.name for row in rows[:3])}"


LIST = Command(
    name="list",
    order=50,
    group="look at what there is",
    help="list what a preset may say and what is shipped, or what a preset holds",
    description="List what a preset may say and what is shipped, a line each, or some of it whole; or what a preset "
    "holds. 'noisy-world list perturbations fog' tells all of fog, 'noisy-world list keys camera' a branch of keys.",
    options=_list_options,
    settle=_settle_list,
    run=_list,
    needs=(),
)


# --- `describe` ---


def _describe_options(parser: Parser) -> None:
    parser.option("name NAME", f"one of what 'noisy-world list WHAT' names: {', '.join(KNOWN)}; or a subcommand")


def _describe(options: argparse.Namespace, _: Entry) -> int:
    """Print all that is said of everything that has the name. Raises InputError where nothing has."""
    found: dict[str, list[KnownThing]] = {}
    names: list[str] = []
    for what, rows in KNOWN.items():
        every = {row.name: row for row in rows()}
        names += every
        if chosen := [row for row in every.values() if _is(what, row.name, options.name)]:
            found[what] = chosen
    if options.name in COMMANDS:
        command = COMMANDS[options.name]
        found["subcommands"] = [KnownThing(command.name, command.help, (command.description,))]
    if not found:
        asked = did_you_mean(options.name, [*names, *COMMANDS])
        raise InputError(
            options.name, "nothing has this name", remedy=asked or "'noisy-world list' counts what has one"
        )
    for what, chosen in found.items():
        print(f"{what}:")
        (print_lines if what == "keys" else print_whole)(chosen)
    return 0


def _is(what: str, name: str, asked: str) -> bool:
    """Tell whether a thing is meant: by its name; a key by a branch; a preset by its file's name too."""
    if what == "keys":
        return _below(name, asked)
    return name == asked or (what == "presets" and asked in (Path(name).name, Path(name).stem))


DESCRIBE = Command(
    name="describe",
    order=55,
    group="look at what there is",
    help="tell all of one thing: a perturbation, a key, a layout, a camera, a metric, ...",
    description="Tell all that is said of one thing by its name, wherever it is listed: 'noisy-world describe fog'. A "
    "perturbation comes with its parameters, their values at each severity, and the place of its picture.",
    options=_describe_options,
    run=_describe,
    needs=(),
)

COMMAND = LIST, DESCRIBE
