# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers that pages say of the code, such as how many perturbations there are, are those of the code."""

import json
import re
import sys
import tomllib
from typing import get_args

import pytest
from worlds import ROOT

from noisy_world.core.channels import CHANNELS
from noisy_world.core.channels.channel import FileKind
from noisy_world.core.datasets.layouts import LAYOUTS, RECORDED
from noisy_world.core.perturbing.kinds import KINDS, ColourPerturbation, DepthPerturbation
from noisy_world.core.planning.estimate import estimate, size_text
from noisy_world.core.planning.plan import read_settings
from noisy_world.core.presets.preset import EngineName, read_preset
from noisy_world.core.scenes.embedded import ROOMS
from noisy_world.evaluation.maps.names import MAP_METRICS
from noisy_world.evaluation.metrics import METRICS
from noisy_world.evaluation.systems.registry import find_system, shipped_names
from noisy_world.perturbations import registry
from noisy_world.sources import SOURCES
from noisy_world.planning import make_plan

sys.path.insert(0, str(ROOT / "headless"))

from bench import cluster_simulation

PAGES = {page.relative_to(ROOT).as_posix(): page for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]}
WORDS = ["none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
WORDS += ["thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen", "twenty"]
NUMBER = rf"(?:\d[\d,]*|{'|'.join(WORDS[1:])})"
COUNTED = rf"\b{NUMBER} (?:perturbations|layouts|settings|sequences|engines|presets)\b"
COMING_ALONG = [item for item in registry().values() if item.distribution is None]
PAPERS = [item for item in COMING_ALONG if not item.source.startswith("our own")]
OURS = [item for item in COMING_ALONG if item.source.startswith("our own")]
COLOUR = [item for item in COMING_ALONG if isinstance(item, ColourPerturbation)]
DEPTH = [item for item in COMING_ALONG if isinstance(item, DepthPerturbation)]


def number(text):
    """A number in digits or in a word."""
    text = text.lower()
    return WORDS.index(text) if text in WORDS else int(text.replace(",", ""))


def text_of(page):
    return re.sub(r"\s+", " ", PAGES[page].read_text(encoding="utf-8"))


def settings(preset):
    return len(read_settings(read_preset(ROOT / f"presets/{preset}.yaml"), registry()))


# Neither an environment nor a remedy that gets one.
WITH_IT = [system for system in map(find_system, shipped_names()) if not (system.environment or system.remedy)]
MIXED = settings("noisy_replica_mixed")
# Page, the words with the numbers in groups, what they have to be.
CLAIMS = [
    ("README.md", r"There are (\S+) perturbations", [len(COMING_ALONG)]),
    ("README.md", r"all (\S+) of the paper's taxonomy, and (\S+) of our own", [len(PAPERS), len(OURS)]),
    ("README.md", r"benchmark of ([\d,]+) sequences", [8 * settings("noisy_replica")]),
    ("README.md", r"with \[(\w+) rooms\]", [ROOMS]),
    ("README.md", r"in two rooms under (\d+) settings", [settings("benchmark")]),
    ("README.md", r"clean and under (\w+) settings", [settings("demo") - 1]),
    ("README.md", r"(\w+) systems come with it", [len(WITH_IT)]),
    ("docs/index.md", r"all (\d+) perturbations", [len(COMING_ALONG)]),
    ("docs/perturbations.md", r"There are (\d+): all (\d+) of the paper's taxonomy, and (\w+) of our own",
     [len(COMING_ALONG), len(PAPERS), len(OURS)]),
    ("docs/perturbations.md", r"mixed.yaml` the (\w+) compositions", [settings("mixed") - 1]),
    ("docs/layouts.md", r"and in (\w+) more that are read alone", [len(RECORDED)]),
    ("docs/recordings.md", r"The (\w+) that are written too", [len(LAYOUTS)]),
    ("docs/generate.md", r"are \[(\w+) others\]\(rooms.md\)", [ROOMS - 1]),
    ("docs/rooms.md", r"^# The embedded rooms (\w+) furnished scenes", [ROOMS]),
    ("docs/noisy_replica.md", r"([\d,]+) sequences: (\d+) scenes of Replica under (\d+) settings",
     [8 * settings("noisy_replica"), 8, settings("noisy_replica")]),
    ("docs/noisy_replica.md", r"colour: (\d+) perturbations x", [len([item for item in COLOUR if item in PAPERS])]),
    ("docs/noisy_replica.md", r"depth: (\d+) perturbations at", [len([item for item in DEPTH if item in PAPERS])]),
    ("docs/noisy_replica.md", r"8 x (\d+) = (\d+) sequences", [MIXED, 8 * MIXED]),
    ("docs/noisy_replica.md", r"the (\w+) columns of the paper's table", [MIXED - 1]),
    ("docs/cost.md", r"in all (\d+) settings", [settings("noisy_rooms")]),
    ("docs/cost.md", r"are ([\d,]+) sequences of", [8 * settings("noisy_rooms")]),
    ("docs/evaluation.md", r"for two rooms, (\d+) settings", [settings("benchmark")]),
    ("docs/results.md", r"All (\d+) settings were run", [settings("six_rooms")]),
    ("docs/report.md", r"six systems in six rooms under (\d+) settings", [settings("six_rooms")]),
    ("docs/study_plan.md", r"Six embedded rooms, (\d+) settings", [settings("six_rooms")]),
    ("docs/study_plan.md", r"over the (\d+) settings of that system", [settings("six_rooms") - 1]),
    ("docs/node_groups.md", r"all (\d+) groups of the shelf", [len([item for item in COLOUR if item.build])]),
    ("docs/decisions.md", r"in (\w+) engines", [len(get_args(EngineName))]),
    ("docs/your_perturbation.md", r"one of (\w+) kinds", [len(KINDS)]),
]  # fmt: skip
BENCHMARK = (f"{8 * settings('noisy_replica'):,} sequences", f"{settings('noisy_replica')} settings")  # on many pages
# What the sweep below may find beside CLAIMS, with what it counts: a part, a measurement, an example.
OTHERS = {
    ("docs/noisy_replica.md", "7 sequences"): "clean and the six of fog in one room",
    ("docs/noisy_replica.md", "six settings"): "three severities, static and dynamic",
    ("docs/node_groups.md", "sixteen settings"): "measured with so many",
    ("docs/node_groups.md", "four groups"): "of the example file",
    ("docs/perturbations.md", "12 settings"): "of the sweep in the line",
    ("docs/recipes.md", "23 settings"): "measured with so many",
    ("docs/recipes.md", "20 perturbations"): "measured with so many",
    ("docs/storage.md", "nine sequences"): "measured with so many",
    ("docs/noisy_replica.md", "768 sequences"): "a product beside it",
    ("docs/noisy_replica.md", "32 sequences"): "a product beside it",
    ("docs/recipes.md", "110 settings"): "without the 15 that move the path",
    ("docs/decisions.md", "Sixteen settings"): "of one call to the compositor",
    ("docs/cluster.md", "100,000 sequences"): "a large dataset, measured",
    ("docs/cluster.md", "3,125 sequences"): "25 scenes, measured",
}


@pytest.mark.parametrize(("page", "pattern", "values"), CLAIMS, ids=str)
def test_a_number_on_a_page_is_that_of_the_code(page, pattern, values):
    found = re.findall(pattern, text_of(page))
    assert found, f"{page} does not say it any more; mend the claim with the page"
    for groups in found:
        assert [number(text) for text in ([groups] if isinstance(groups, str) else groups)] == values


@pytest.mark.parametrize("page", sorted(PAGES))
def test_no_page_counts_what_is_not_held(page):
    """A new "31 perturbations" has to be among the claims, or its meaning in OTHERS."""
    text = text_of(page)
    held = [match.span() for where, pattern, _ in CLAIMS if where == page for match in re.finditer(pattern, text)]
    loose = [
        found[0]
        for found in re.finditer(
            rf"\b{NUMBER} (?:perturbations|layouts|settings|sequences|engines|presets)\b", text, re.I
        )
        if not any(start <= found.start() < end for start, end in held)
        and (page, found[0]) not in OTHERS
        and found[0] not in BENCHMARK
        and number(found[0].split()[0]) > 3  # two settings, all three sequences: of an example beside it
    ]
    assert loose == []


def test_what_is_excepted_is_there():
    assert [(page, words) for page, words in OTHERS if words not in text_of(page)] == []


def test_the_registries_are_named_on_their_pages():
    assert set(re.findall(r"^\| `(\w+)`", PAGES["docs/systems.md"].read_text(encoding="utf-8"), re.MULTILINE)) >= {
        "rgbd_odometry",
        "orb_slam3",
    }
    both = PAGES["docs/systems.md"].read_text(encoding="utf-8") + PAGES["docs/other_systems.md"].read_text(
        encoding="utf-8"
    )
    assert [name for name in shipped_names() if f"`{name}`" not in both] == []
    assert re.search(r"engine: cycles, .*# (.*)", PAGES["docs/generate.md"].read_text(encoding="utf-8"))[1].split(
        " | "
    ) == list(get_args(EngineName))
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(
        re.findall(r"^\| `(\w+)` \|", PAGES["docs/install.md"].read_text(encoding="utf-8"), re.MULTILINE)
    ) == set(extras)
    written = re.search(r"layout: replica +# (.*)", PAGES["docs/generate.md"].read_text(encoding="utf-8"))[1]
    assert written.split(" | ") == list(LAYOUTS)
    rows = re.search(
        r"these are read alone:\n\n(.*?)\n\n", PAGES["docs/recordings.md"].read_text(encoding="utf-8"), re.S
    )[1].splitlines()
    assert len(rows) - 2 == len(RECORDED)


def test_the_table_of_channels_is_that_of_the_registry():
    page = PAGES["docs/channels.md"].read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| .* \| \((.*)\) (\w+)[^|]* \| [^|]* \| (.*) \|$", page, re.MULTILINE)
    assert [row[0] for row in rows] == list(CHANNELS)
    for name, shape, dtype, files in rows:
        channel = CHANNELS[name]
        assert (shape, dtype) == ("H, W, 3" if channel.components == 3 else "H, W", channel.dtype)
        assert [kind for kind in re.findall(r"`(\w+)`", files) if kind in get_args(FileKind)] == list(channel.kinds)


def test_the_table_of_layouts_is_that_of_the_registry():
    page = PAGES["docs/layouts.md"].read_text(encoding="utf-8")
    (head,) = re.findall(r"^\| key of `output` \| what it does \| (.*) \|$", page, re.MULTILINE)
    assert head.split(" | ") == list(LAYOUTS)
    said = {
        key: [cell.replace("`", "").split(", ") for cell in cells.split(" | ")]
        for key, cells in re.findall(r"^\| `(image|colour|depth_scale_per_m)` \| [^|]* \| (.*) \|$", page, re.MULTILINE)
    }
    assert said["image"] == [list(layout.images) for layout in LAYOUTS.values()]
    assert [cell[0] for cell in said["colour"]] == [layout.colours[0] for layout in LAYOUTS.values()]
    assert said["depth_scale_per_m"] == [[f"{layout.depth_scale_per_m:g}"] for layout in LAYOUTS.values()]


def test_the_table_of_metrics_is_that_of_the_registry():
    page = PAGES["docs/metrics.md"].read_text(encoding="utf-8")
    table = re.search(r"## The metrics\n.*?\n\|---\|---\|---\|\n(.*?)\n\n", page, re.S)[1]
    named = [name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert sorted(named) == sorted(METRICS)


def test_the_page_of_metrics_names_those_of_maps():
    page = PAGES["docs/metrics.md"].read_text(encoding="utf-8")
    *_, table = re.findall(r"\| name \| what it is \| when it misleads \|\n\|---\|---\|---\|\n(.*?)\n\n", page, re.S)
    named = [name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert named == [name for name, metric in MAP_METRICS.items() if metric.group != "paper"]


def test_the_table_of_sources_is_that_of_the_registry():
    page = PAGES["docs/generate.md"].read_text(encoding="utf-8")
    table = re.search(r"\| key \| what it is \|\n\|---\|---\|\n(.*?)\n\n", page, re.S)[1]
    assert re.findall(r"\| `(\w+)` \| (.*) \|", table) == [(name, kind.meaning) for name, kind in SOURCES.items()]


# --- what the benchmark costs: one measurement, in docs/cost.md ---


def measured():
    """Core-hours by column and bytes, as docs/cost.md has them."""
    text = text_of("docs/cost.md")
    embree, cycles = re.search(r"\| in all \| ([\d.]+) \| ([\d.]+) \|", text).groups()
    return float(embree), float(cycles), float(re.search(r"The images take ([\d.]+) TB", text)[1])


def test_all_pages_give_the_benchmark_one_size():
    embree, cycles, terabytes = measured()
    replica, cluster = text_of("docs/noisy_replica.md"), text_of("docs/cluster.md")
    assert f"takes {cycles:g} core-hours and {terabytes:g} TB; {embree:g} core-hours with" in replica
    assert re.search(r"([\d.]+) core-hours and ([\d.]+) TB for the", cluster).groups() == (
        f"{cycles:g}",
        f"{terabytes:g}",
    )
    written_out = re.search(r"Written out instead of linked they would take ([\d.]+) TB", text_of("docs/cost.md"))[1]
    assert f"{written_out} TB if all frames were written out" in replica
    share = re.search(r"TB, (\d+) % of what they would", text_of("docs/cost.md"))[1]
    assert float(written_out) == pytest.approx(terabytes / (int(share) / 100), abs=0.06)
    work = cluster_simulation.Work()
    assert (work.core_s / 3600, work.size_bytes / 1e12) == (cycles, terabytes)


PARTS = re.findall(
    r"^\| (`--.*`|all) \| ([\d,]+) \| ([\d,]+) \| ([\d.]+ [GT]B) \| ([\d.]+) (min|h) \|$",
    (ROOT / "docs/noisy_replica.md").read_text(encoding="utf-8"),
    re.MULTILINE,
)


def test_the_estimates_are_what_a_dry_run_says():
    assert len(PARTS) == 5
    for options, sequences, frames, size, time, unit in PARTS:
        key, _, value = options.strip("`").partition(" ")
        names = value.strip("'").split(",")
        change = [f"only={json.dumps({key.strip('-'): names})}"] if value else []
        plan = make_plan(read_preset(ROOT / "presets/noisy_rooms.yaml", change), None)
        guess = estimate(plan)
        assert (len(plan.sequences), sum(len(render.frames) for render in plan.renders)) == (
            number(sequences), number(frames),
        ), options  # fmt: skip
        assert size_text(guess.bytes_written) == size, options
        assert guess.seconds / {"min": 60, "h": 3600}[unit] == pytest.approx(
            float(time), abs=0.5 if unit == "min" else 0.05
        )
        if options == "all":
            _, cycles, terabytes = measured()
            # The estimate is rough; it may not be another size.
            assert guess.bytes_written / 1e12 == pytest.approx(terabytes, rel=0.15)
            assert guess.seconds / 1800 == pytest.approx(cycles, rel=0.15)
