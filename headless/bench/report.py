# SPDX-License-Identifier: GPL-3.0-or-later
"""Speed against error, measured on this machine: every engine and number of samples, Embree and a peer beside them.

    python headless/bench/report.py [--out DIR] [--rounds N]
    python headless/bench/report.py --rays [--mesh MESH.ply --trajectory TRAJ.txt] [--turns N]

Writes report.md, report.json and speed_against_error.png. Each contestant is a process that has loaded its scene and
waits. In every round each makes a few frames in turn, so ratios compare neighbours in time. A figure is the median of
the rounds; its spread is the distance between the least and the largest, divided by the median.
"""

import argparse
import json
import platform
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import cv2
import numpy as np
from bench.results import Contestant, ContestantError, EngineRow, Results, Spread, markdown, spread, spread_of_ratios
from numpy.typing import NDArray

from noisy_world.core.geometry import Intrinsics
from noisy_world.core.machine import available_threads, processor_features
from noisy_world.core.packages import package_version
from noisy_world.images.pixels import rgb_bytes
from noisy_world.rooms import kept_room
from noisy_world.scenes.ply_writer import write_ply
from noisy_world.scenes.polygon_mesh import Mesh
from noisy_world.trajectories.handheld import handheld_path

BENCH = ROOT / "headless" / "bench"
PEER_PYTHON = ROOT / ".venv-peer" / "bin" / "python"


CAMERA = Intrinsics(1200, 680, 600.0, 600.0, 599.5, 339.5)  # Replica's
PATH_FRAMES = 24  # of the path that turns go around; chosen
ERROR_FRAMES = [16]  # a reference takes as long as 256 frames
REFERENCE_SAMPLES = 256  # chosen: the colours' noise is then a sixteenth of that of one sample

TURN_S = 2.0  # of work before the next contestant's turn; chosen: some frames each, within the machine's fluctuations
STEADY_FRAMES = (20, 200)  # memory is compared between these frames
CONFIGURATIONS = (
    ("embree", 1),
    ("embree", 9),
    ("cycles", 1),
    ("cycles", 4),
    ("cycles", 16),
    ("eevee", 1),
    ("eevee", 4),
    ("workbench", 1),
    ("workbench", 5),
)


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="report.py", description="Measure speed against error on this machine.")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "bench", help="where the report goes")
    parser.add_argument("--rounds", type=int, default=3, help="turns that each contestant takes (default 3)")
    parser.add_argument("--rays", action="store_true", help="only print what engine embree takes beside its rays alone")
    parser.add_argument("--mesh", type=Path, help="with --rays: a PLY file, beside the million quads")
    parser.add_argument("--trajectory", type=Path, help="with --rays: its path, in Replica's format")
    parser.add_argument("--turns", type=int, default=6, help="with --rays: of four frames each (default 6)")
    options = parser.parse_args(arguments)
    if options.rounds < 1:
        parser.error("--rounds has to be at least 1")
    if (options.mesh is None) != (options.trajectory is None):
        parser.error("--mesh and --trajectory go together")
    if options.rays:
        return rays_only(options)
    options.out.mkdir(parents=True, exist_ok=True)
    start_s = time.perf_counter()
    results = Results(machine())
    with tempfile.TemporaryDirectory(prefix="noisy-world-bench-") as scratch:
        work = Path(scratch)
        tell("the scenes")
        write_room(work)
        write_million(work)
        million_quads(work, results, options.rounds)
        engines(work, results, options.rounds)
        needs(work, results, options.rounds)
        tell("hard cases")
        cases = Contestant("hard cases", [sys.executable, BENCH / "hard_cases.py"])
        results.hard_cases = list(cases.start)
        cases.stop()
    results.seconds = time.perf_counter() - start_s
    (options.out / "report.json").write_text(json.dumps(asdict(results), indent=1) + "\n", encoding="utf-8")
    draw(results, options.out / "speed_against_error.png")
    (options.out / "report.md").write_text(markdown(results), encoding="utf-8")
    print(f"wrote {options.out / 'report.md'} in {results.seconds / 60:.1f} minutes")
    return 0


def tell(what: str) -> None:
    """Print what is being measured."""
    print(f"[{time.strftime('%H:%M:%S')}] {what}", file=sys.stderr, flush=True)


def machine() -> dict[str, Any]:
    """Describe machine and versions."""
    import bpy

    names = [line.split(":", 1)[1].strip() for line in _cpuinfo() if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "threads": available_threads(),
        "features": [name for name in processor_features() if name.startswith("AVX")],
        "system": platform.platform(),
        "noisy_world": package_version(),
        "blender": bpy.app.version_string,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def _cpuinfo() -> Iterable[str]:
    path = Path("/proc/cpuinfo")
    return path.read_text().splitlines() if path.exists() else []


# --- scenes ---


def write_room(work: Path) -> None:
    """Write the embedded room as triangles (programs triangulate quads differently), and a path through it."""
    room = kept_room()
    write_ply(work / "room.ply", room, triangulate=True)
    path = handheld_path(room, seed=1, frames=PATH_FRAMES, rate_hz=2.0)
    np.savetxt(work / "room.txt", path.c2w.reshape(-1, 16), fmt="%.17g")


def write_million(work: Path) -> None:
    """Write a wavy floor of a million quads with another colour at every vertex, and a path over it."""
    count = 1000
    grid_m = np.linspace(-3.0, 3.0, count + 1)
    x, y = np.meshgrid(grid_m, grid_m)
    vertices_m = np.stack([x, y, 0.2 * np.sin(3 * x) * np.cos(2 * y)], axis=-1).reshape(-1, 3)
    first = np.arange(count * (count + 1)).reshape(count, count + 1)[:, :-1].ravel()
    quads = np.stack([first, first + 1, first + count + 2, first + count + 1], axis=-1).astype(np.int32)
    colours = np.random.default_rng(0).random(vertices_m.shape, dtype=np.float32)
    starts = np.arange(0, quads.size, 4, dtype=np.int32)
    write_ply(work / "million.ply", Mesh(vertices_m, colours, quads.ravel(), starts))
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (40, 1, 1))  # looking straight down
    poses[:, :3, 3] = np.stack([0.02 * np.arange(40), np.zeros(40), np.full(40, 2.5)], axis=-1)
    np.savetxt(work / "million.txt", poses.reshape(-1, 16), fmt="%.17g")


def renderer(work: Path, scene: str, name: str, *flags: str, **changes: Any) -> Contestant:
    """Start our own renderer on a scene. changes: of the preset, by section."""
    preset = {
        "scenes": [{"name": scene, "mesh": str(work / f"{scene}.ply"), "trajectory": str(work / f"{scene}.txt")}],
        **changes,
    }
    path = work / f"{name}.yaml"
    path.write_text(json.dumps(preset))  # JSON is YAML
    return Contestant(name, [sys.executable, BENCH / "renderer.py", path, work / "out" / name, *flags])


def peer(script: str, work: Path, scene: str) -> Contestant:
    """Start a peer on the same scene."""
    numbers = (CAMERA.width_px, CAMERA.height_px, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px)
    files = (work / f"{scene}.ply", work / f"{scene}.txt")
    return Contestant(script, [PEER_PYTHON, BENCH / f"{script}.py", *files, *map(str, numbers)])


def peers(work: Path, scene: str, results: Results) -> dict[str, Contestant]:
    """Start the peers that are available here; note those that are not."""
    there: dict[str, Contestant] = {}
    for script in ("embree", "pyrender_peer"):
        if not PEER_PYTHON.exists():
            results.notes.append("no peers: `make peer-env` needs Python 3.11, which is not here")
            return {}
        try:
            there[script] = peer(script, work, scene)
        except ContestantError as error:
            results.notes.append(f"left out: {error}")
    return there


# --- measurements ---


def take_turns(contestants: Sequence[Contestant], rounds: int) -> None:
    """Let each work for about TURN_S, one after another, for so many rounds."""
    frames = {item.name: 1 for item in contestants}
    for item in contestants:  # find how many frames make a turn; where the first one takes as long, it is one
        if item.start.get("first_frame_s", 0.0) < TURN_S:
            frames[item.name] = max(1, round(TURN_S / item.ask(do="time", frames=[0])["frame_s"]))
    for turn in range(rounds):
        for item in contestants:
            start = turn * frames[item.name]
            item.take_turn(list(range(start, start + frames[item.name])))


def million_quads(work: Path, results: Results, rounds: int) -> None:
    """Time one sample on a million quads beside casting rays alone; measure memory; try two processes of one thread."""
    tell("a million quads")
    ours = renderer(work, "million", "million")
    embree = peers(work, "million", results).pop("embree", None)
    resident: dict[int, int] = {}
    answer: dict[str, Any] = {}
    done = 1  # frames that the process has rendered by itself
    turns = max(8, 2 * rounds)
    each = -(-(STEADY_FRAMES[1] - done) // turns)
    for _ in range(turns):
        if embree:
            embree.take_turn(list(range(each)))
        answer = ours.take_turn(list(range(each)))
        done += each
        resident[done] = answer["resident_bytes"]
    early = min(resident, key=lambda frame: abs(frame - STEADY_FRAMES[0]))
    results.million = {
        "first_frame_s": ours.start["first_frame_s"],
        "loading_s": ours.start["loading_s"],
        "frame_s": asdict(spread(ours.turns)),
        "embree_s": asdict(spread(embree.turns)) if embree else None,
        "times_embree": asdict(spread_of_ratios(ours.turns, embree.turns)) if embree else None,
        "peak_bytes": answer["peak_bytes"],
        "resident_bytes": resident,
        "growth": resident[max(resident)] / resident[early] - 1,
    }
    results.million["pair"] = asdict(two_processes(work, ours, max(3, rounds)))
    results.million["rays"] = rays_alone(work, "million", results, turns)
    for item in (ours, embree):
        if item:
            item.stop()


def rays_alone(work: Path, scene: str, results: Results, turns: int) -> dict[str, Any] | None:
    """Measure engine embree in seconds of one processor, and the rays alone; return None where embreex is missing."""
    try:
        ours = renderer(work, scene, f"{scene}_rays", render={"engine": "embree"})
    except ContestantError as error:
        results.notes.append(f"left out: {error}")
        return None
    frames: list[float] = []
    rays: list[float] = []
    lines: list[float] = []
    for turn in range(turns):
        these = list(range(4 * turn, 4 * turn + 4))
        bare = ours.ask(do="rays", frames=these)
        rays.append(bare["core_s"])
        lines.append(bare["output_core_s"])
        frames.append(ours.ask(do="time", frames=these)["core_s"])
    found = {
        "frame_core_s": spread(frames),
        "bare_core_s": spread(rays),
        "times_bare": spread_of_ratios(frames, rays),
        "times_output": spread_of_ratios(frames, lines),
    }
    ours.stop()
    return {
        **{name: asdict(value) for name, value in found.items()},
        **{name: ours.start[name] for name in ("loading_s", "first_frame_s", "peak_bytes")},
    }


def two_processes(work: Path, alone: Contestant, rounds: int) -> Spread:
    """Return the time of a frame by two processes of one thread each, divided by that of one process of two."""
    pair = [renderer(work, "million", f"million{k}", "--one-thread") for k in range(2)]
    frames = list(range(8))
    ratios = []
    for _ in range(rounds):
        before = alone.take_turn(frames)["frame_s"]
        start_s = time.perf_counter()
        for item in pair:
            item.send(do="time", frames=frames)
        for item in pair:
            item.answer()
        ratios.append((time.perf_counter() - start_s) / (2 * len(frames)) / before)
    for item in pair:
        item.stop()
    return spread(ratios)


def engines(work: Path, results: Results, rounds: int) -> None:
    """Time every engine and number of samples on the room, then measure their"""
    tell("engines: loading")
    ours: dict[tuple[str, int], Contestant] = {}
    for engine, samples in CONFIGURATIONS:
        try:
            ours[engine, samples] = renderer(
                work, "room", f"{engine}{samples}", render={"engine": engine, "samples": samples}
            )
        except ContestantError as error:
            results.notes.append(f"left out: {error}")
    there = peers(work, "room", results)
    tell("engines: time")
    take_turns([*ours.values(), *there.values()], rounds)
    embree = there.get("embree")
    for script, item in there.items():
        results.others.append(
            {
                "name": {"embree": "Embree, bare rays (Open3D)", "pyrender_peer": "pyrender"}[script],
                "frame_s": asdict(spread(item.turns)),
                "loading_s": item.start["loading_s"],
            }
        )
    tell("engines: errors")
    truth = work / "truth"
    truth.mkdir()
    if embree:
        embree.ask(do="truth", frames=ERROR_FRAMES, to=str(truth))
    reference = save_reference(work)
    for (engine, samples), item in ours.items():
        folder = work / f"frames-{engine}{samples}"
        folder.mkdir()
        saved = item.ask(do="frames", frames=ERROR_FRAMES, to=str(folder))
        results.rows.append(
            EngineRow(
                engine,
                samples,
                saved["rays_per_px"] or samples,
                spread(item.turns),
                spread_of_ratios(item.turns, embree.turns) if embree else spread([]),
                item.start["first_frame_s"],
                item.start["loading_s"],
                item.ask(do="memory")["peak_bytes"],
                rgb_errors(folder, reference, ERROR_FRAMES),
                item.ask(do="analytic"),
                cast_errors(folder, truth, ERROR_FRAMES) if embree else {},
            )
        )
    for item in (*ours.values(), *there.values()):
        item.stop()


def save_reference(work: Path) -> Path:
    """Render the reference of colour."""
    folder = work / "reference"
    folder.mkdir()
    item = renderer(
        work, "room", "reference", render={"samples": REFERENCE_SAMPLES}, output={"modalities": ["rgb"]}, seed=1
    )
    item.ask(do="frames", frames=ERROR_FRAMES, to=str(folder))
    item.stop()
    return folder


def needs(work: Path, results: Results, rounds: int) -> None:
    """Compare presets that ask for less with one that switches everything on."""
    tell("only what a scene needs")
    contestants = {
        "clean: colour and depth": renderer(work, "room", "clean"),
        "depth only": renderer(work, "room", "depth", output={"modalities": ["depth"]}),
        "colour only": renderer(work, "room", "colour", output={"modalities": ["rgb"]}),
        "everything on": renderer(work, "room", "all", "--all-on", render={"samples": 4}),
    }
    take_turns(list(contestants.values()), 2 * rounds)
    full = contestants["everything on"]
    for name, item in contestants.items():
        results.needs.append(
            {
                "name": name,
                "samples": 4 if item is full else 1,
                **{key: item.start[key] for key in ("passes", "lights", "bounces", "libraries", "first_frame_s")},
                "peak_bytes": item.ask(do="memory")["peak_bytes"],
                "frame_s": asdict(spread(item.turns)),
                "of_clean": asdict(spread_of_ratios(item.turns, contestants["clean: colour and depth"].turns)),
                "of_everything": asdict(spread_of_ratios(item.turns, full.turns)),
            }
        )
    for item in contestants.values():
        item.stop()


# --- errors of saved frames ---


# Chosen. docs/speed_against_error.md states the first two with the results.
EDGE_JUMP = 0.05  # of the nearer depth: a larger jump between neighbours is an edge
EDGE_REACH_PX = 2  # pixels as near as this to an edge are counted apart
WRONG_SURFACE = 0.01  # of the depth: at an edge, a larger error means that another surface is shown


def rgb_errors(folder: Path, reference: Path, frames: list[int]) -> dict[str, float]:
    """Return mean PSNR (dB) and SSIM of 8-bit colours against the reference's."""
    psnr, ssim = [], []
    for frame in frames:
        mine, other = (rgb_bytes(np.load(side / f"{frame}.npz")["rgb"]) for side in (folder, reference))
        psnr.append(cv2.PSNR(mine, other))
        ssim_of = cv2.quality.QualitySSIM_compute  # pyright: ignore[reportAttributeAccessIssue]  not in OpenCV's stubs
        similarity, _ = ssim_of(mine, other)
        ssim.append(float(np.mean(similarity[:3])))
    return {"psnr_db": float(np.mean(psnr)), "ssim": float(np.mean(ssim))}


def cast_errors(folder: Path, truth: Path, frames: list[int]) -> dict[str, float]:
    """Return relative errors of depth against cast rays: off edges the largest and the 99.9 % quantile, at edges the
    share of wrong surfaces.
    """
    off, at, void = [], [], []
    share = []
    for frame in frames:
        depth_m = np.load(folder / f"{frame}.npz")["depth_m"].astype(np.float64)
        true_m = np.load(truth / f"{frame}.npy")
        edge = edges(true_m)
        both = (depth_m > 0) & (true_m > 0)
        error = np.abs(np.where(both, depth_m, 1.0) / np.where(both, true_m, 1.0) - 1)
        off.append(error[both & ~edge])
        at.append(error[both & edge])
        void.append(((depth_m > 0) != (true_m > 0)).mean())
        share.append(edge.mean())
    off_all, at_all = np.concatenate(off), np.concatenate(at)
    return {
        "off_median": float(np.median(off_all)),
        "off_p999": float(np.quantile(off_all, 0.999)),
        "off_beyond_2e-4": float((off_all > 2e-4).mean()),
        "edge_share": float(np.mean(share)),
        "edge_median": float(np.median(at_all)),
        "edge_wrong_surface": float((at_all > WRONG_SURFACE).mean()),
        "void_differs": float(np.mean(void)),
    }


def edges(depth_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return a mask (H, W) of the pixels within EDGE_REACH_PX of a jump of depth or a border of void."""
    jump = np.zeros(depth_m.shape, bool)
    for axis in (0, 1):
        a, b = np.moveaxis(depth_m, axis, 0)[:-1], np.moveaxis(depth_m, axis, 0)[1:]
        step = np.abs(a - b) > EDGE_JUMP * np.minimum(a, b)
        view = np.moveaxis(jump, axis, 0)
        view[:-1] |= step
        view[1:] |= step
    size = 2 * EDGE_REACH_PX + 1
    return cv2.dilate(jump.astype(np.uint8), np.ones((size, size), np.uint8)).astype(bool)


# --- the plot ---


MARKS = {"cycles": "o", "eevee": "s", "workbench": "^", "embree": "D"}


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return the points that no other beats in both coordinates (less is better), by rising first coordinate."""
    best = float("inf")
    front = []
    for index in sorted(range(len(points)), key=lambda k: points[k]):
        if points[index][1] < best:
            best = points[index][1]
            front.append(index)
    return front


def draw(results: Results, path: Path) -> None:
    """Draw and save."""
    import matplotlib as mpl  # slow, and needed only at the end

    mpl.use("Agg")
    from matplotlib import pyplot
    from matplotlib.lines import Line2D

    figure, (colour, depth) = pyplot.subplots(1, 2, figsize=(11, 4.6), constrained_layout=True)
    colour_error = [255 * 10 ** (-row.rgb["psnr_db"] / 20) for row in results.rows]
    depth_error = [max(shape["max"] for shape in row.analytic.values()) for row in results.rows]
    panels = (
        (colour, colour_error, "colour: RMS difference from 256 samples, of 255"),
        (depth, depth_error, "depth: largest relative error off edges"),
    )
    for axes, error, label in panels:
        times_s = [row.frame_s.median for row in results.rows]
        for row, time_s, value in zip(results.rows, times_s, error, strict=True):
            half = time_s * row.frame_s.relative / 2
            axes.errorbar(time_s, value, xerr=half, fmt=MARKS[row.engine], color=f"C{list(MARKS).index(row.engine)}")
            axes.annotate(f"{row.samples}", (time_s, value), textcoords="offset points", xytext=(6, 4), fontsize=8)
        front = pareto_front(list(zip(times_s, error, strict=True)))
        axes.plot([times_s[k] for k in front], [error[k] for k in front], "k--", linewidth=0.8, zorder=0)
        axes.set(xscale="log", yscale="log", xlabel="seconds a frame, colour and depth on disk", ylabel=label)
        axes.grid(visible=True, which="both", linewidth=0.3)
    colour.yaxis.set_minor_formatter("{x:g}")
    colour.yaxis.set_major_formatter("{x:g}")
    for item in results.others:
        colour.axvline(item["frame_s"]["median"], color="grey", linewidth=0.8, linestyle=":")
        colour.text(
            item["frame_s"]["median"],
            0.02,
            f" {item['name']}",
            rotation=90,
            fontsize=7,
            color="grey",
            transform=colour.get_xaxis_transform(),
        )
    handles = [
        Line2D([], [], marker=mark, linestyle="", color=f"C{k}", label=engine)
        for k, (engine, mark) in enumerate(MARKS.items())
    ]
    handles.append(Line2D([], [], linestyle="--", color="k", linewidth=0.8, label="best trade-offs"))
    depth.legend(handles=handles, fontsize=8, title="number: samples")
    machine = results.machine
    figure.suptitle(
        f"Room of 1.6 million triangles, 1200 x 680; {machine['processor']}, {machine['threads']} threads; "
        f"Noisy World {machine['noisy_world']}, Blender {machine['blender']}",
        fontsize=9,
    )
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


# --- engine embree beside its rays alone ---


def rays_only(options: argparse.Namespace) -> int:
    """Measure the million quads and a mesh of one's own; return the exit status."""
    results, scenes = Results({}), ["million"]
    with tempfile.TemporaryDirectory(prefix="noisy-world-bench-") as scratch:
        work = Path(scratch)
        write_million(work)
        if options.mesh is not None:
            scenes.append(options.mesh.stem)
            (work / f"{options.mesh.stem}.ply").symlink_to(options.mesh.resolve())
            (work / f"{options.mesh.stem}.txt").symlink_to(options.trajectory.resolve())
        for scene in scenes:
            found = rays_alone(work, scene, results, options.turns)
            if found is None:
                print(*results.notes, sep="\n", file=sys.stderr)
                return 1
            frame, bare, output = (
                Spread(**found[name]).text() for name in ("frame_core_s", "times_bare", "times_output")
            )
            print(f"{scene}: a frame on disk {frame} s, {bare} of bare rays, {output} of run(output=1); "
                  f"loading {found['loading_s']:.1f} s")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
