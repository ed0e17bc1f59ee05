# SPDX-License-Identifier: GPL-3.0-or-later
"""What the whole benchmark costs: processor time of a few frames by stage, and of 1,000 sequences of 2,000 frames.

    python headless/bench/cost.py [--out DIR] [--preset PRESET] [--scene NAME] [--frames N] [--engine ENGINE ...]
                                  [--backend reference|compositor] [--set KEY=VALUE ...]

Makes N frames of one scene, spread over its path, in all settings, in this process and a temporary folder, once for
each engine, and writes cost.md and cost.json. OpenCV uses one thread, so that what it does is counted where it is asked
for. Loading, with making node groups, is taken once for each scene; everything else grows with the frames. "Rendering"
is all that the writing threads do not do: with the compositor, its work too. Processor time depends on what else the
machine does: where two threads share a core, or caches, the same work takes up to twice as long. Compare neighbours in
time.
"""

import argparse
import json
import sys
import tempfile
import threading
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

from bench.results import table

from noisy_world.core.machine import LOADING, RENDERING, peak_memory_bytes
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.plan import Plan, make_plan
from noisy_world.dataset.run import Run
from noisy_world.preset.keys import read_preset

PRESET = ROOT / "presets" / "noisy_rooms.yaml"
WHOLE_FRAMES = 2000  # of a sequence of the benchmark
WHOLE_SCENES = 8
IMAGES = ("jpg", "png")


@dataclass(frozen=True)
class Cost:
    """What frames of every setting of a scene took.

    label: of what made them. frames: of a sequence. renders, images: rendered frames and images of all sequences, links
    too. seconds: of processors by stage. bytes, naive_bytes: of the images with every file counted once, and for each
    of its names. peak_bytes: of memory.
    """

    label: str
    frames: int
    renders: int
    images: int
    seconds: Mapping[str, float]
    bytes: int
    naive_bytes: int
    peak_bytes: int

    def hours(self, stage: str) -> float:
        """Return the core-hours of a stage for the whole benchmark."""
        times = WHOLE_SCENES if stage == LOADING else WHOLE_SCENES * WHOLE_FRAMES / self.frames
        return self.seconds.get(stage, 0.0) * times / 3600

    @property
    def whole_hours(self) -> float:
        """The core-hours of the whole benchmark."""
        return sum(map(self.hours, self.seconds))

    @property
    def beside_hours(self) -> float:
        """Those of all but loading and rendering."""
        return self.whole_hours - self.hours(LOADING) - self.hours(RENDERING)


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="cost.py", description="Measure what the whole benchmark costs.")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "bench", help="where cost.md and cost.json go")
    parser.add_argument("--preset", type=Path, default=PRESET, help="the benchmark (default noisy_rooms.yaml)")
    parser.add_argument("--scene", help="the scene that is made (default: the first)")
    parser.add_argument("--frames", type=int, default=4, help="how many frames of each sequence (default 4)")
    parser.add_argument("--engine", action="append", help="a renderer; give it again for another (default cycles)")
    parser.add_argument("--backend", default="reference", help="what perturbs colour (default reference)")
    parser.add_argument("--set", action="append", default=[], help="another key of the preset, as for generate")
    options = parser.parse_args(arguments)
    if options.frames < 1:
        parser.error("--frames has to be at least 1")
    cv2.setNumThreads(1)
    costs = []
    for engine in options.engine or ["cycles"]:
        keys = [f"render.engine={engine}", f"render.backend={options.backend}", *options.set]
        with tempfile.TemporaryDirectory(prefix="noisy-world-cost-") as folder:
            plan = spread_frames(options.preset, keys, options.scene, options.frames)
            costs.append(measured(f"{engine}, {options.backend}", plan, options.frames, Path(folder) / "out"))
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "cost.json").write_text(json.dumps([asdict(cost) for cost in costs], indent=1) + "\n")
    (options.out / "cost.md").write_text(markdown(costs) + "\n", encoding="utf-8")
    print(markdown(costs))
    return 0


def spread_frames(preset: Path, keys: Sequence[str], scene: str | None, frames: int) -> Plan:
    """Return the plan of a scene with all settings, its path thinned to a few frames from its beginning to its end."""
    scene = scene or make_plan(read_preset(preset, keys)).scenes[0].name
    whole = make_plan(read_preset(preset, keys, scenes=[scene]))
    every = whole.scenes[0].frame_count // frames
    if not every:
        raise SystemExit(f"{scene} has fewer than {frames} frames")
    number = int(whole.scenes[0].place.path.rpartition(".")[2])
    thinned = [f"scenes.{number}.trajectory.every={every}", f"scenes.{number}.trajectory.stop={every * frames}"]
    return make_plan(read_preset(preset, [*keys, *thinned], scenes=[scene]))


def measured(label: str, plan: Plan, frames: int, out: Path) -> Cost:
    """Make a plan's dataset and return what it took."""
    report = Run(plan, out, progress=PlainProgress(sys.stderr), stop=threading.Event()).make_dataset()
    files = [path.stat() for path in out.rglob("*") if path.suffix.lstrip(".") in IMAGES and path.parent != out]
    once = {found.st_ino: found.st_size for found in files}
    return Cost(
        label=label,
        frames=frames,
        renders=report.frames_rendered,
        images=len(files),
        seconds=report.processor_s,
        bytes=sum(once.values()),
        naive_bytes=sum(found.st_size for found in files),
        peak_bytes=peak_memory_bytes() or 0,
    )


def markdown(costs: Sequence[Cost]) -> str:
    """Return the tables: of the whole, and of the stages."""
    columns = ["", "core-hours in all", "but for loading and rendering", "a written image", "bytes", "of naive copies"]
    rows = []
    for cost in costs:
        whole = WHOLE_SCENES * WHOLE_FRAMES / cost.frames
        image_ms = cost.beside_hours * 3600 / (cost.images * whole) * 1000
        share = f"{100 * cost.bytes / cost.naive_bytes:.0f} %"
        sizes = f"{cost.bytes * whole / 1e12:.2f} TB"
        row = [cost.label, f"{cost.whole_hours:.1f}", f"{cost.beside_hours:.1f}", f"{image_ms:.1f} ms", sizes, share]
        rows.append(row)
    stages = sorted({stage for cost in costs for stage in cost.seconds}, key=lambda item: -costs[0].hours(item))
    lines = [[stage, *(f"{cost.hours(stage):.2f}" for cost in costs)] for stage in stages]
    frames = costs[0].frames
    return "\n\n".join(
        [
            "# What the whole benchmark costs",
            f"1,000 sequences of {WHOLE_FRAMES:,} frames, extrapolated from {frames} frames of each setting of one "
            "scene; images are counted with all their names. Core-hours are processor time, over all threads.",
            table(columns, rows),
            "## Core-hours by stage",
            table(["", *(cost.label for cost in costs)], lines),
        ]
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
