# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's measurements, and the spread of a figure over several turns."""

import json
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Spread:
    """A figure from several turns: the median, and the distance from the least to the largest divided by it."""

    median: float
    relative: float
    turns: int

    def text(self, unit: str = "") -> str:
        """Return the figure as text: `0.283 s ± 4 %`."""
        return "-" if not self.turns else f"{self.median:.3g}{unit} ± {100 * self.relative:.0f} %"


def spread(values: Sequence[float]) -> Spread:
    """Summarise turns."""
    if not values:
        return Spread(float("nan"), float("nan"), 0)
    low, median, high = np.quantile(values, [0, 0.5, 1])
    return Spread(float(median), float((high - low) / median), len(values))


def spread_of_ratios(values: Sequence[float], others: Sequence[float]) -> Spread:
    """Summarise the ratios of neighbouring turns."""
    return spread([a / b for a, b in zip(values, others, strict=False)])


@dataclass
class EngineRow:
    """A row of the table, for one engine at one number of samples; times in seconds, memory in bytes.

    rays_per_px: of colour, the mean.
    """

    engine: str
    samples: int
    rays_per_px: float
    frame_s: Spread
    times_embree: Spread
    first_frame_s: float
    loading_s: float
    peak_bytes: int
    rgb: dict[str, float]
    analytic: dict[str, dict[str, float]]
    cast: dict[str, float]


@dataclass
class Results:
    """Everything measured; report.json holds all of it."""

    machine: dict[str, Any]
    rows: list[EngineRow] = field(default_factory=list)
    others: list[dict[str, Any]] = field(default_factory=list)
    million: dict[str, Any] = field(default_factory=dict)
    needs: list[dict[str, Any]] = field(default_factory=list)
    hard_cases: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0


# --- the report in Markdown ---


def markdown(results: Results) -> str:
    """Return the whole report."""
    parts = [
        "# Speed against error",
        _machine(results),
        "## Engines and samples",
        "The embedded room, 1.6 million triangles, 1200 x 680; a frame is colour and depth rendered, encoded and on "
        "disk. PSNR and SSIM: 8-bit colours against Cycles with 256 samples. Depth against surfaces of known shape "
        "(plane, sphere, box): largest relative error off edges. Depth against rays cast at the same triangles, "
        "evaluated in float64: the error that 99.9 % of the pixels off edges stay below, and at edges (within 2 px of "
        "a jump of 5 %) the share that shows another surface.",
        _engines(results),
        "![Speed against error](speed_against_error.png)",
        "## Beside it, in the same run",
        _others(results),
        "## One sample on a million quads",
        _million(results),
        "## Only what a scene needs",
        _needs(results),
        "## Hard cases",
        *[_case(case) for case in results.hard_cases],
    ]
    return "\n\n".join(parts) + "\n"


def table(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Lay out a Markdown table."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(_cell(cell) for cell in line) + " |" for line in lines)


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "0" if value == 0 else f"{value:.3g}"
    return str(value)


def _megabytes(count: float) -> str:
    return f"{count / 1e6:.0f} MB"


def _spread(content: dict[str, Any] | None) -> Spread:
    return spread([]) if content is None else Spread(**content)


def _machine(results: Results) -> str:
    m = results.machine
    text = (
        f"{m['processor']}, {m['threads']} threads ({', '.join(m['features'])}), {m['system']}. Noisy World "
        f"{m['noisy_world']}, Blender {m['blender']}, Python {m['python']}, numpy {m['numpy']}. Measured in "
        f"{results.seconds / 60:.1f} minutes. After ±: the distance between the least and "
        "the largest of the turns, over their median."
    )
    return "\n\n".join([text, *[f"Note: {note}." for note in results.notes]])


def _engines(results: Results) -> str:
    columns = ("engine", "samples", "rays a pixel", "frame", "x Embree", "first frame", "loading", "peak memory")
    columns += ("PSNR", "SSIM")
    columns += ("depth: known shapes", "depth: cast, 99.9 %", "at edges: another surface", "void differs")
    rows = [
        (
            row.engine,
            row.samples,
            float(row.rays_per_px),
            row.frame_s.text(" s"),
            row.times_embree.text(),
            f"{row.first_frame_s:.2f} s",
            f"{row.loading_s:.1f} s",
            _megabytes(row.peak_bytes),
            f"{row.rgb['psnr_db']:.1f} dB",
            f"{row.rgb['ssim']:.4f}",
            max(shape["max"] for shape in row.analytic.values()),
            row.cast.get("off_p999", "-"),
            f"{100 * row.cast['edge_wrong_surface']:.2f} %" if row.cast else "-",
            f"{100 * row.cast['void_differs']:.4f} %" if row.cast else "-",
        )
        for row in results.rows
    ]
    return table(columns, rows)


def _others(results: Results) -> str:
    if not results.others:
        return "No peer could be had here."
    rows = [
        (item["name"], _spread(item["frame_s"]).text(" s"), f"{item['loading_s']:.1f} s") for item in results.others
    ]
    return table(("program", "frame", "loading"), rows)


def _million(results: Results) -> str:
    m = results.million
    resident = {int(frame): size for frame, size in m["resident_bytes"].items()}
    rows = [
        ("first frame after loading", f"{m['first_frame_s']:.2f} s"),
        ("frame, on disk", _spread(m["frame_s"]).text(" s")),
        ("Embree, the bare rays", _spread(m["embree_s"]).text(" s")),
        ("frame over Embree", _spread(m["times_embree"]).text()),
        ("two processes of one thread over one of two, time of a frame", _spread(m["pair"]).text()),
        ("peak memory", _megabytes(m["peak_bytes"])),
        (
            "memory by frame",
            ", ".join(
                f"{frame}: {_megabytes(resident[frame])}" for frame in sorted(resident)[:: max(1, len(resident) // 5)]
            ),
        ),
        ("growth from about frame 20 to frame 200", f"{100 * m['growth']:.2f} %"),
    ]
    if m.get("rays"):
        rays = m["rays"]
        rows += [
            ("engine embree: frame, on disk, of one processor", _spread(rays["frame_core_s"]).text(" s")),
            ("engine embree: the bare rays, of one processor", _spread(rays["bare_core_s"]).text(" s")),
            ("engine embree: frame over bare rays", _spread(rays["times_bare"]).text()),
            ("engine embree: frame over run(output=1)", _spread(rays["times_output"]).text()),
            ("engine embree: loading, first frame", f"{rays['loading_s']:.1f} s, {rays['first_frame_s']:.2f} s"),
            ("engine embree: peak memory", _megabytes(rays["peak_bytes"])),
        ]
    return table(("", ""), rows)


def _needs(results: Results) -> str:
    columns = ("preset", "passes", "samples", "lights", "bounces", "libraries", "first frame", "peak memory")
    columns += ("frame", "over clean", "over everything")
    rows = [
        (
            item["name"],
            ", ".join(item["passes"]),
            item["samples"],
            item["lights"],
            item["bounces"],
            ", ".join(item["libraries"]),
            f"{item['first_frame_s']:.2f} s",
            _megabytes(item["peak_bytes"]),
            _spread(item["frame_s"]).text(" s"),
            _spread(item["of_clean"]).text(),
            _spread(item["of_everything"]).text(),
        )
        for item in results.needs
    ]
    return table(columns, rows)


def _case(case: dict[str, Any]) -> str:
    return "\n\n".join([f"### {case['title']}", table(case["columns"], case["rows"]), case["note"]])


# --- processes that wait for orders in lines of JSON, so that several can be measured in turns ---


class ContestantError(Exception):
    """A process ended before it answered; the message holds its last line."""


class Contestant:
    """A process that waits for orders."""

    def __init__(self, name: str, command: Sequence[str | Path]) -> None:
        self.name = name
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - kept as long as the process
        self._process = subprocess.Popen(
            [str(part) for part in command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._orders, self._answers = self._process.stdin, self._process.stdout
        self.start: Any = self.answer()  # a dict; of the hard cases a list
        self.turns: list[float] = []

    def answer(self) -> dict[str, Any]:
        """Wait for the next answer. Raises ContestantError if none comes."""
        for line in self._answers:
            if line.startswith("@"):
                return json.loads(line[1:])
        self._process.wait()
        self._log.seek(0)
        words = self._log.read().decode(errors="replace").strip().splitlines()
        raise ContestantError(f"{self.name}: {words[-1] if words else 'ended without a word'}")

    def send(self, **order: Any) -> None:
        """Give an order without waiting."""
        self._orders.write(json.dumps(order) + "\n")
        self._orders.flush()

    def ask(self, **order: Any) -> dict[str, Any]:
        """Give an order and wait for the answer."""
        self.send(**order)
        return self.answer()

    def take_turn(self, frames: list[int]) -> dict[str, Any]:
        """Let it make these frames, and keep the time per frame."""
        answer = self.ask(do="time", frames=frames)
        self.turns.append(answer["frame_s"])
        return answer

    def stop(self) -> None:
        """End the process."""
        self._orders.close()
        self._process.wait()
