# SPDX-License-Identifier: GPL-3.0-or-later
"""Write what pages and presets say of perturbations, channels, layouts and more from the objects that are told of.

A page has such a part between a line `<!-- made: NAME -->` and a line `<!-- end -->`; `make pages` writes all of them
anew, and the presets of single perturbations. With --check nothing is written, and what would change is told.

python headless/tools/pages.py
"""

import argparse
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields
from itertools import takewhile
from pathlib import Path
from textwrap import fill
from typing import TypeVar

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon")]

import numpy as np
from numpy.typing import NDArray

from noisy_world.channels import CHANNELS, Channel
from noisy_world.cli.command import COMMANDS
from noisy_world.core.lens import Distortion, straightened
from noisy_world.core.packages import Registry, project_address
from noisy_world.core.schema import ConfigPath, parse
from noisy_world.evaluate.map_metrics import MAP_METRICS
from noisy_world.evaluate.metrics import METRICS, Metric
from noisy_world.evaluate.systems import find_system, shipped_names
from noisy_world.layouts import EVERY, Layout, RecordedLayout
from noisy_world.layouts.with_reader import LayoutWithReader
from noisy_world.perturbations import registry
from noisy_world.perturbations.kinds import STAGES, Perturbation
from noisy_world.preset.camera_devices import CAMERA_DEVICES, CameraDevice
from noisy_world.preset.sensor_keys import DistortionSpec
from noisy_world.sources import SOURCES, preset_keys
from noisy_world.trajectories.formats import TRAJECTORY_FORMATS

T = TypeVar("T")

WIDTH = 120  # of a line of prose
MOST_NAMED = 10  # parameters in a row of the table; of longer lists the first ones
STAGE_TITLES = {"post": "Post-processing"}
STAGE_NOTES = {"depth": "Warm is near, blue is far, grey is void."}


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status: 1 where --check finds that something would change."""
    parser = argparse.ArgumentParser(prog="pages.py", description="Write the parts of pages that objects tell.")
    parser.add_argument("--check", action="store_true", help="write nothing; tell what would change")
    check = parser.parse_args(arguments).check
    changed = {path: text for path, text in made_files(ROOT) if not path.is_file() or path.read_text("utf-8") != text}
    left = [path for path in (ROOT / "presets/perturbations").glob("*.yaml") if path.stem not in own_perturbations()]
    for path in sorted([*changed, *left]):
        print(f"{path.relative_to(ROOT)}: {'`make pages` changes it' if check else 'written anew'}")
    if check:
        return 1 if changed or left else 0
    for path, text in changed.items():
        path.write_text(text, encoding="utf-8")
    for path in left:
        path.unlink()
    return 0


def made_files(root: Path) -> Iterator[tuple[Path, str]]:
    """Yield each file that is made, or has made parts, with its text."""
    for page in [root / "README.md", *sorted((root / "docs").glob("*.md"))]:
        text = page.read_text(encoding="utf-8")
        if "<!-- made: " in text:
            yield page, with_parts(text, PARTS, page.name)
    for name, (before, line) in ADDRESSED.items():
        yield root / name, with_address((root / name).read_text(encoding="utf-8"), before, line, project_address())
    notebook = (root / NOTEBOOK).read_text(encoding="utf-8")
    address = re.sub(r'(REPOSITORY = \\")[^\\]*', rf"\g<1>{project_address()}", notebook)
    yield root / NOTEBOOK, address
    for item in own_perturbations().values():
        yield root / f"presets/perturbations/{item.name}.yaml", example_preset(item)


def with_parts(text: str, parts: Mapping[str, Callable[[], str]], page: str) -> str:
    """Return a page with its parts made anew. Raises SystemExit where it names a part that is not made."""

    def made(match: re.Match[str]) -> str:
        if (name := match[1]) not in parts:
            raise SystemExit(f"pages: {page}: no part is called {name}; known: {', '.join(parts)}")
        part = f"{parts[name]()}\n\n".lstrip("\n")
        return f"<!-- made: {name} -->\n\n{part}<!-- end -->"

    return re.sub(r"<!-- made: ([\w ]+) -->\n.*?<!-- end -->", made, text, flags=re.DOTALL)


# --- the project's address, which blender_manifest.toml holds ---


MADE = "  # made: website"
ADDRESSED = {
    "CITATION.cff": ("license:", "repository-code: {}"),
    "pyproject.toml": ("dynamic = ", 'urls = {{ Repository = "{}" }}'),
    "mkdocs.yml": ("site_description:", """copyright: '<a href="{0}">{0}</a>'"""),
}
"""Files that are not pages, with the beginning of a line, and the line below it that has the address."""
NOTEBOOK = "docs/examples/own_images.ipynb"  # whose first cell fetches the project from there


def with_address(text: str, before: str, line: str, address: str) -> str:
    """Return a file's text with the address in a line below the one that begins so; without that if there is none."""
    lines = [one for one in text.splitlines() if not one.endswith(MADE)]
    if address:
        (place,) = (number for number, one in enumerate(lines) if one.startswith(before))
        lines.insert(place + 1, line.format(address) + MADE)
    return "\n".join(lines) + "\n"


def address_sentence() -> str:
    """Return where the project is, for the README; "" until somebody has published it."""
    return f"The project is at <{address}>: `git clone {address}`." if (address := project_address()) else ""


def table(columns: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> str:
    """Return a table of Markdown."""
    head, *body = (f"| {' | '.join(row)} |" for row in (columns, *rows))
    return "\n".join((head, f"|{'---|' * len(columns)}", *body))


# --- subcommands ---


def command_table() -> str:
    """Return the table of subcommands, ours alone, by what they are for; --help says what each does."""
    groups: dict[str, list[str]] = {}
    for command in ours(COMMANDS):
        groups.setdefault(command.group, []).append(command.name)
    return table(("to", "subcommands"), ((group, listed(names)) for group, names in groups.items()))


# --- perturbations ---


def own_perturbations() -> dict[str, Perturbation]:
    """Return those that come with Noisy World, by name, in the order of propagation."""
    return {name: item for name, item in registry().items() if item.distribution is None}


def perturbation_counts() -> str:
    """Return the sentence that counts them."""
    every = own_perturbations().values()
    papers = sum(item.about.of_paper for item in every)
    others = sum(item.about.of_imagenet_c for item in every)
    own = len(every) - papers - others
    return wrapped(
        f"There are {len(every)}: all {papers} of the paper's taxonomy, {others} more by which ImageNet-C is whole, "
        f"and {own} of our own that look and act as in the world. The [gallery](gallery.md) shows every one of them."
    )


def perturbation_table() -> str:
    """Return the table of all of them."""
    every = own_perturbations().values()
    rows = ((f"{item.stage} {item.order}", f"`{item.name}`", law_of(item), parameters_of(item)) for item in every)
    return table(("stage, order", "name", "what it is", "parameters"), rows)


def law_of(item: Perturbation) -> str:
    """Return what a perturbation is."""
    law = item.about.law or f"{item.sentence[:1].lower()}{item.sentence[1:]}"
    return f"{origin}: {law}" if (origin := origin_of(item, "our own")) else law


def origin_of(item: Perturbation, ours: str) -> str:
    """Return whose a perturbation is, in a word or two; "" for the paper's."""
    return "" if item.about.of_paper else "ImageNet-C's" if item.about.of_imagenet_c else ours


def parameters_of(item: Perturbation) -> str:
    """Return the names of a perturbation's parameters, those that severity sets first."""
    names = sorted((field.name for field in fields(item.parameters)), key=lambda name: name not in item.severities)
    shown = names if len(names) <= MOST_NAMED else names[: MOST_NAMED - 3]
    return ", ".join(f"`{name}`" for name in shown) + (" and more" if len(shown) < len(names) else "")


def gallery() -> str:
    """Return the pictures of all of them, by stage; what each does stands in the table, and is not said again."""
    parts: list[str] = []
    every = own_perturbations().values()
    for stage in STAGES:
        parts.append(f"## {STAGE_TITLES.get(stage, stage.capitalize())}")
        parts += [STAGE_NOTES[stage]] if stage in STAGE_NOTES else []
        for item in (item for item in every if item.stage == stage):
            about = item.about
            picture = f"![{about.picture or f'{item.label} at severities 1, 3 and 5'}](gallery/{item.name}.jpg)"
            whose = f", {origin}" if (origin := origin_of(item, "ours")) else ""
            caption = f"{about.caption[:1].upper()}{about.caption[1:].removesuffix('.')}." if about.caption else ""
            lines = (f"### {item.label}: `{item.name}`{whose}", picture, wrapped(caption))
            parts.append("\n".join(filter(None, lines)))
    return re.sub(r"\n\n(?=### )", "\n", "\n\n".join(parts))


def example_preset(item: Perturbation) -> str:
    """Return the preset that shows a perturbation in the embedded room."""
    example = item.about.example
    text = example.text or f"{item.label} in the embedded room, clean and at severities 1, 3 and 5."
    settings = example.settings or (f"{{sweep: {{perturb: [{item.name}], severities: [1, 3, 5]}}}}",)
    walk = f"{{handheld: {{frames: {example.frames}, rate_hz: {example.rate_hz}}}}}"
    lines = [
        f"# {text}",
        "seed: 7",
        "scenes:",
        f'  - {{name: room, mesh: "embedded:room", trajectory: {walk}}}',
        *([f"render: {example.render}"] if example.render else []),
        "settings:",
        "  - {name: clean}",
        *(f"  - {line}" for line in settings),
        "output: {overview: true}",
    ]
    return "\n".join(lines) + "\n"


def wrapped(text: str) -> str:
    """Return prose in lines."""
    return fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


# --- channels ---


def channel_table() -> str:
    """Return the table of the channels that come with Noisy World."""
    rows = (
        (quoted(item.name), item.meaning, item.convention, values_of(item), item.unit, listed(item.kinds))
        for item in ours(CHANNELS)
    )
    return table(("channel", "what it is", "what its files hold", "in memory", "unit", "files"), rows)


def values_of(item: Channel) -> str:
    """Return the shape and the type of a channel's values in memory."""
    return f"{'(H, W)' if item.components == 1 else f'(H, W, {item.components})'} {item.dtype}"


# --- where clean frames come from, and how they are stored ---


def format_table() -> str:
    """Return the table of the formats of trajectories."""
    rows = (
        (quoted(item.name), item.looks_like or item.meaning, item.recognised_by, item.times)
        for item in ours(TRAJECTORY_FORMATS)
    )
    return table(("format", "what it looks like", "recognised by", "times"), rows)


def source_table() -> str:
    """Return the table of the sources, by the keys of scenes."""
    return table(("key", "what it is"), ((quoted(item.name), item.meaning) for item in ours(SOURCES)))


def layout_table() -> str:
    """Return the table of the layouts that are written and read."""
    rows = (
        (quoted(item.name), item.meaning, listed(item.images), listed(item.colours), f"{item.depth_scale_per_m:g}")
        for item in ours(EVERY)
        if isinstance(item, Layout)
    )
    return table(("`layout`", "what it is", "`image`", "`colour`", "`depth_scale_per_m`"), rows)


def recorded_layout_table() -> str:
    """Return the table of the layouts of others' recordings; some are written too."""
    own = (item for item in ours(EVERY) if isinstance(item, RecordedLayout | LayoutWithReader))
    own = sorted(own, key=lambda item: item.order)
    return table(
        ("layout", "what it is", "its files"), ((item.label, item.meaning, quoted(item.files)) for item in own)
    )


def key_tables() -> str:
    """Return the keys of a preset: a table for each branch. Keys of a branch that say the same share a row.

    A lens has one branch, wherever it stands.
    """
    branches: dict[str, dict[str, list[str]]] = {}
    for name, said in preset_keys():
        parts = name.removeprefix("scenes[].").split(".")
        inside = name.startswith("scenes[].")
        branch = f"a scene's {parts[0]}" if inside and len(parts) > 1 else "a scene" if inside else parts[0]
        branch = "a lens" if "distortion" in parts[:-1] else branch
        branches.setdefault(branch, {}).setdefault(said.replace("|", "\\|"), []).append(name)
    several = {branch: shared(rows) for branch, rows in branches.items() if len(rows) > 1}
    alone = {said: names for rows in branches.values() if len(rows) == 1 for said, names in rows.items()}
    return "\n\n".join(
        f"## {branch[:1].upper()}{branch[1:].removesuffix('[]')}\n\n"
        + table(("key", "what it says"), ((listed(names), said) for said, names in rows.items()))
        for branch, rows in {"the preset": alone, **several}.items()
    )


def shared(rows: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """Return names by what is said of them; neighbours of which the same is said but for a word or two are one."""
    joined: list[tuple[list[str], list[str]]] = []
    for said, names in rows.items():
        if joined and len(names) == len(joined[-1][0]) == 1 and one_meaning([*joined[-1][0], said]):
            joined[-1] = ([*joined[-1][0], said], [*joined[-1][1], *names])
        else:
            joined.append(([said], names))
    return {one_meaning(said): names for said, names in joined}


def camera_table() -> str:
    """Return the table of the real cameras."""
    return table(
        ("device", "image", "field of view, degrees", "lens", "rows", "the calibration is of"),
        ((quoted(item.name), *camera_facts(item)) for item in ours(CAMERA_DEVICES)),
    )


def camera_facts(item: CameraDevice) -> tuple[str, ...]:
    """Return size, field of view, lens, readout and origin of a real camera."""
    it = item.intrinsics
    rows = item.steps.get("rolling_shutter", {}).get("readout_ms")
    return (
        f"{it.width_px} x {it.height_px}",
        " x ".join(f"{angle:.0f}" for angle in field_of_view_deg(item)),
        str(item.distortion.get("model", "radial-tangential")) if item.distortion else "pinhole",
        "of one moment" if rows is None else f"{rows:g} ms",
        item.sources["lens"],
    )


# --- how systems are judged ---


def metric_table() -> str:
    """Return the table of the metrics of paths."""
    return metrics_in(ours(METRICS))


def map_metric_table() -> str:
    """Return the table of the metrics of maps, without the paper's."""
    return metrics_in(item for item in ours(MAP_METRICS) if item.group != "paper")


def metrics_in(items: Iterable[Metric]) -> str:
    """Return a table of metrics. Neighbours that say the same but for a word or two share a row."""
    rows: list[tuple[list[str], list[str], tuple[str, str, str]]] = []
    for item in items:
        meaning, rest = item.meaning.removesuffix("."), (item.unit, item.better, item.misleads)
        if rows and rows[-1][2] == rest and one_meaning([*rows[-1][1], meaning]):
            rows[-1][0].append(item.name)
            rows[-1][1].append(meaning)
        else:
            rows.append(([item.name], [meaning], rest))
    return table(
        ("name", "unit", "better", "what it is", "when it misleads"),
        (
            (listed(names), unit, better, one_meaning(meanings), misleads)
            for names, meanings, (unit, better, misleads) in rows
        ),
    )


def one_meaning(meanings: list[str]) -> str:
    """Return what texts say that differ in one place, by at most two words, with these beside; "" for others."""
    words = [meaning.split() for meaning in meanings]
    begin = len(common_beginning(words))
    end = len(common_beginning([one[begin:][::-1] for one in words]))
    apart = [" ".join(one[begin : len(one) - end]) for one in words]
    if len(meanings) > 1 and (begin + end < 5 or any(not 0 < len(text.split()) <= 2 for text in apart)):
        return ""
    first = words[0]
    several = [*(text.rstrip(";,") for text in apart[:-1]), apart[-1]]
    return " ".join([*first[:begin], ", ".join(filter(None, several)), *first[len(first) - end :]]).strip()


def common_beginning(texts: list[list[str]]) -> list[str]:
    """Return the words that all of some texts begin with."""
    return [same[0] for same in takewhile(lambda same: len(set(same)) == 1, zip(*texts, strict=False))]


def system_table() -> str:
    """Return the table of the systems, but for those that are installed beside the project."""
    found = (find_system(name) for name in shipped_names())
    rows = (
        (
            quoted(item.name),
            item.about.removesuffix("."),
            f"the environment `{item.environment}`" if item.environment else "nothing more",
            "to the byte" if item.repeatable else "no",
        )
        for item in found
        if item.environment or not item.remedy
    )
    return table(("system", "is", "needs", "the same twice"), rows)


def field_of_view_deg(item: CameraDevice) -> tuple[float, float]:
    """Return how wide and how high a real camera sees, through its optical axis."""
    it = item.intrinsics
    lens = parse(DistortionSpec, dict(item.distortion), ConfigPath(item.name)).lens if item.distortion else None
    across = np.array([-0.5 - it.cx_px, it.width_px - 0.5 - it.cx_px]) / it.fx_px
    down = np.array([-0.5 - it.cy_px, it.height_px - 0.5 - it.cy_px]) / it.fy_px
    return angle_deg(lens, across, np.zeros(2)), angle_deg(lens, np.zeros(2), down)


def angle_deg(lens: Distortion | None, x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Return the angle between what two points of the image plane, focal length 1, see."""
    plane = (x, y) if lens is None else straightened(lens, x, y)
    seen = np.stack([*plane, np.ones(2)], axis=-1)
    first, second = seen / np.linalg.norm(seen, axis=-1, keepdims=True)
    return math.degrees(math.acos(first @ second))


def ours(registry: Registry[T]) -> Iterator[T]:
    """Yield what comes with Noisy World."""
    return (item for name, item in registry.items() if registry.distribution(name) is None)


def listed(words: Iterable[str]) -> str:
    """Return words as code, one after another."""
    return ", ".join(map(quoted, words))


def quoted(word: str) -> str:
    """Return a word as code."""
    return f"`{word}`"


PARTS: dict[str, Callable[[], str]] = {
    "address": address_sentence,
    "subcommands": command_table,
    "perturbation counts": perturbation_counts,
    "perturbation table": perturbation_table,
    "gallery": gallery,
    "channel table": channel_table,
    "format table": format_table,
    "source table": source_table,
    "layout table": layout_table,
    "recorded layout table": recorded_layout_table,
    "keys": key_tables,
    "camera table": camera_table,
    "metric table": metric_table,
    "map metric table": map_metric_table,
    "system table": system_table,
}

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
