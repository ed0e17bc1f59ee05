# SPDX-License-Identifier: GPL-3.0-or-later
"""The perturbations, both backends, beside a peer on the same frames: time, error, distance from the peer's severities.

    python headless/bench/perturbation_report.py FRAMES [--targets TARGETS.csv] [--out DIR] [--seeds N]

FRAMES: a folder of colour images; they are resized to 1200 x 680. TARGETS.csv: what the severities should look like
(columns corruption, severity, psnr, ssim, mean_shift). The peer is imagecorruptions, in the environment that
`make corruptions-env` builds. Writes perturbations.md.
"""

import argparse
import csv
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

import bpy
import cv2
import numpy as np
from bench.results import Contestant, table
from numpy.typing import NDArray

from noisy_world.core.schema import ConfigPath
from noisy_world.images.pixels import as_float, rgb_bytes
from noisy_world.nodes.compositor import Compositor
from noisy_world.nodes.node_trees import ensure_group
from noisy_world.perturb import apply
from noisy_world.perturbations import registry
from noisy_world.perturbations.execution import perturb_colour
from noisy_world.perturbations.groups import build_group
from noisy_world.perturbations.kinds import SEVERITIES, ColourPerturbation, DepthPerturbation, FrameContext
from noisy_world.perturbations.parsing import parse_steps
from noisy_world.perturbations.steps import Step

PEER_PYTHON = ROOT / ".venv-corruptions" / "bin" / "python"


SIZE_PX = (1200, 680)
TIMED_SEVERITY = 3
SLOW = ("glass_blur",)  # the peer takes 15 s a frame, so it is not asked
# How far from the targets a figure may be without being counted; otherwise 1 dB, 0.03 and 3 of 255. Chosen: wider where
# a perturbation is random by frame as a whole, or the pictures of ice are others.
PSNR_DB = {"frost": 1.5, "fog": 1.5, "motion_blur": 1.5, "glass_blur": 1.5}
SSIM = {"frost": 0.06}
SHIFT = {"fog": 5.0, "frost": 10.0}
BACKENDS = ("reference", "compositor")
DECIMALS = {"psnr": 2, "ssim": 3, "mean_shift": 2}


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="perturbation_report.py", description="Measure the perturbations.")
    parser.add_argument("frames", type=Path, help="a folder of colour images")
    parser.add_argument("--targets", type=Path, help="what the severities should look like, as CSV")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "bench", help="where the report goes")
    parser.add_argument("--seeds", type=int, default=2, help="the figures are the mean over so many seeds (default 2)")
    options = parser.parse_args(arguments)
    paths = sorted(path for path in options.frames.glob("*") if path.suffix.lower() in (".jpg", ".png"))
    if not paths:
        parser.error(f"{options.frames}: no .jpg or .png there")
    options.out.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)
    frames = np.stack([read_frame(path) for path in paths])
    coloured = [item for item in registry().values() if isinstance(item, ColourPerturbation)]
    names = [item.name for item in coloured if item.source.startswith("paper")]  # those that the peer has too
    with tempfile.TemporaryDirectory() as folder:
        clean = Path(folder) / "clean.npy"
        np.save(clean, frames)
        peer = None
        if PEER_PYTHON.exists():
            peer = Contestant("peer", [PEER_PYTHON, ROOT / "headless/bench/corruptions_peer.py", clean])
        text, reference_ms = times(names, frames, peer)
        parts = ["# The perturbations", text, depth_times()]
        everything = [item.name for item in coloured if item.nodes]
        parts += ["## Node groups", building(everything), errors(frames)]
        parts += [group_times(names, frames, reference_ms), previews(everything, frames)]
        if options.targets and peer:
            parts += ["## Severities", fidelity(names, frames, peer, options.targets, seeds=options.seeds)]
        if peer:
            peer.stop()
        else:
            parts.append("No peer: `make corruptions-env` builds its environment where Python 3.11 is.")
    (options.out / "perturbations.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    print(f"wrote {options.out / 'perturbations.md'}")
    return 0


def read_frame(path: Path) -> NDArray[np.uint8]:
    """Return an image file as a frame, (H, W, 3) RGB."""
    rgb = np.asarray(cv2.imread(str(path)), np.uint8)[..., ::-1]
    return np.asarray(cv2.resize(rgb, SIZE_PX, interpolation=cv2.INTER_CUBIC), np.uint8)


def timed(call: Any, count: int) -> float:
    """Return the seconds of processor time per call."""
    start_s = time.process_time()
    for index in range(count):
        call(index)
    return (time.process_time() - start_s) / count


def times(names: list[str], frames: NDArray[np.uint8], peer: Contestant | None) -> tuple[str, dict[str, float]]:
    """Time the reference of every perturbation of colour at one severity, uint8 in and out, in turns with the peer.

    Returns the text and milliseconds by name.
    """
    rows, ratios, found_ms = [], [], {}
    count = len(frames)
    for name in names:
        mine, theirs = [], []

        def call(index: int, name: str = name) -> None:
            apply(frames[index % count], name, severity=TIMED_SEVERITY, frame=index)

        call(0)
        for _ in range(5):
            mine.append(timed(call, 8))
            if peer and name not in SLOW:
                order = {"name": name, "severity": TIMED_SEVERITY, "frames": [index % count for index in range(8)]}
                theirs.append(peer.ask(do="time", **order)["frame_s"])
        found_ms[name] = 1e3 * float(np.median(mine))
        fields: tuple[object, object] = ("-", "-")
        if theirs:
            ratios.append(1e3 * float(np.median(theirs)) / found_ms[name])
            fields = (1e3 * float(np.median(theirs)), ratios[-1])
        rows.append((name, found_ms[name], *fields))
    sizes = f"{SIZE_PX[0]} x {SIZE_PX[1]}"
    text = f"Severity {TIMED_SEVERITY}, {sizes}, uint8 RGB in and out, processor time in one thread."
    if ratios:
        mean = float(np.exp(np.mean(np.log(ratios))))
        text += f" Geometric mean of the ratios, without {' and '.join(SLOW)}: {mean:.1f}."
    rows_text = table(("perturbation", "reference, ms", "peer, ms", "times faster"), rows)
    return "\n\n".join([text, rows_text]), found_ms


def depth_times() -> str:
    """Time the perturbations of depth on a slanted floor with void."""
    ramp = np.linspace(0.5, 9.0, SIZE_PX[1], dtype=np.float32)
    depth_m = np.repeat(ramp[:, None], SIZE_PX[0], axis=1)
    depth_m[100:200, 300:500] = 0
    depth_m[:, 600:] *= np.float32(0.8)
    rows = []
    for item in registry().values():
        if isinstance(item, DepthPerturbation):

            def call(index: int, name: str = item.name) -> None:
                apply(depth_m, name, severity=TIMED_SEVERITY, frame=index)

            call(0)
            rows.append((item.name, 1e3 * float(np.median([timed(call, 6) for _ in range(5)]))))
    return table(("perturbation of depth", "ms"), rows)


def fidelity(names: list[str], frames: NDArray[np.uint8], peer: Contestant, targets: Path, *, seeds: int) -> str:
    """Compare each severity's PSNR, SSIM and mean shift, means over frames and seeds, with the targets."""
    with targets.open(newline="", encoding="utf-8") as file:
        wanted = {(row["corruption"], int(row["severity"])): row for row in csv.DictReader(file)}
    rows: list[tuple[object, ...]] = []
    missed = dict.fromkeys(BACKENDS, 0)
    for name in names:
        drawn = range(seeds) if registry()[name].temporals else range(1)
        for severity in SEVERITIES:
            target = wanted[name, severity]
            for backend in BACKENDS:
                each = [measured(backend, name, severity, seed, frames=frames, peer=peer) for seed in drawn]
                found = {key: float(np.mean([one[key] for one in each])) for key in each[0]}
                off = {key: found[key] - float(target[key]) for key in ("psnr", "ssim", "mean_shift")}
                bars = (PSNR_DB.get(name, 1.0), SSIM.get(name, 0.03), SHIFT.get(name, 3.0))
                within = all(abs(value) <= bar for value, bar in zip(off.values(), bars, strict=True))
                missed[backend] += not within
                figures = [f"{found[key]:.{count}f} ({off[key]:+.{count}f})" for key, count in DECIMALS.items()]
                rows.append((name, severity, backend, *figures, "" if within else "beyond the bars"))
    counts = ", ".join(f"{backend} {count}" for backend, count in missed.items())
    text = f"In brackets: less the target. Beyond the bars, of {len(rows) // len(BACKENDS)}: {counts}."
    head = ("perturbation", "severity", "backend", "PSNR, dB", "SSIM", "shift", "")
    return "\n\n".join([text, table(head, rows)])


def measured(
    backend: str, name: str, severity: int, seed: int, *, frames: NDArray[np.uint8], peer: Contestant
) -> dict[str, float]:
    """Perturb the frames with one seed and let the peer's library measure them."""
    if backend == "compositor":
        images = composited(frames, {"x": [step_of(name, severity)]}, seed=seed)["x"]
    else:
        images = [apply(frame, name, severity=severity, seed=seed, frame=k) for k, frame in enumerate(frames)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "other.npy"
        np.save(path, np.stack(images))
        return peer.ask(do="metrics", file=str(path))


# --- the node groups beside the references: error where nothing is random, and time ---


SEED = 3
TURNS = 5  # chosen: the median of five is little disturbed by other load on the machine
EXACT = (
    "brightness",
    "contrast",
    "pixelate",
    "gaussian_blur",
    "defocus_blur",
    "motion_blur",
    "haze",
    "fog_depth",
    "defocus_depth",
)
GIVEN = {"motion_blur": {"max_angle_deg": 0.0, "angle_deg": 30.0}}  # a fixed angle, so that nothing is random


def step_of(name: str, severity: float, **given: Any) -> Step:
    """Return a step of one severity. given: other parameters."""
    (step,) = parse_steps([{name: {"severity": severity, **given}}], ConfigPath("report"), registry())
    return step


def slope(size_px: tuple[int, int]) -> NDArray[np.float32]:
    """Return planar depth (H, W) in metres, from 0.5 to 9, with void."""
    depth_m = np.repeat(np.linspace(0.5, 9.0, size_px[1], dtype=np.float32)[:, None], size_px[0], axis=1)
    depth_m[size_px[1] // 4 : size_px[1] // 3, size_px[0] // 4 : size_px[0] // 3] = 0
    return depth_m


def composited(
    frames: NDArray[np.uint8], steps: Mapping[str, Sequence[Step]], *, seed: int = SEED
) -> dict[str, list[NDArray[np.uint8]]]:
    """Perturb (N, H, W, 3) frames by chains; return by the chains' names an image for each frame."""
    size_px = frames.shape[2], frames.shape[1]
    made: dict[str, list[NDArray[np.uint8]]] = {name: [] for name in steps}
    with Compositor(size_px, steps, size_px[0]) as compositor:
        for k, frame in enumerate(frames):
            results = compositor.perturb(frame, dict.fromkeys(steps, (k, (seed, "", ""))), slope(size_px))
            for name, (image, _) in results.items():
                made[name].append(frame if image is None else image)
    return made


def errors(frames: NDArray[np.uint8]) -> str:
    """Compare the groups without randomness with the reference on a frame, in float values."""
    rgb = as_float(frames[0])
    size_px = rgb.shape[1], rgb.shape[0]
    depth_m = slope(size_px)
    rows = []
    for name in (*EXACT, "jpeg_compression"):
        row: list[object] = [name]
        for severity in (1, 2, 3, 4, 5):
            values = {"severity": severity, **GIVEN.get(name, {})}
            (step,) = parse_steps([{name: values}], ConfigPath("report"), registry())
            with Compositor(size_px, {"x": [step]}, size_px[0]) as compositor:
                found = evaluated(compositor, rgb, depth_m)
            context = step.context(FrameContext(0, (SEED, "", ""), read_depth_m=lambda: depth_m))
            wanted = np.clip(perturb_colour(step, rgb, severity, context), 0, 1)
            apart = np.abs(found - wanted) * 255
            row.append(f"{apart.max():.2f} ({apart.mean():.3f})")
        rows.append(row)
    text = "Largest difference (mean in brackets) from the reference, in 255ths, float to float, at severities 1 to 5."
    return "\n\n".join([text, table(("perturbation", "1", "2", "3", "4", "5"), rows)])


def evaluated(compositor: Compositor, rgb: NDArray[np.float32], depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return what the chain "x" makes of the first frame of a sequence."""
    image = compositor.evaluate(rgb, {"x": (0, (SEED, "", ""))}, depth_m)[0]["x"]
    assert image is not None, "no severity is 0"
    return image


def group_times(names: Sequence[str], frames: NDArray[np.uint8], reference_ms: Mapping[str, float]) -> str:
    """Time every group, less the time of a pass-through taken in turns, and all groups of severity 3 in one call."""
    size_px = frames.shape[2], frames.shape[1]
    rgb, depth_m = as_float(frames[0]), slope(size_px)
    rows, nets = [], []
    for name in names:
        chains = {"none": (), **{f"{severity}": (step_of(name, severity),) for severity in (3, 5)}}
        took = timed_in_turns(size_px, rgb, depth_m, chains)
        net = {key: took[key] - took["none"] for key in ("3", "5")}
        nets.append(net["3"])
        rows.append((name, 1e3 * net["3"], 1e3 * net["5"], reference_ms.get(name, "-")))
    together = timed_in_turns(
        size_px, rgb, depth_m, {"none": (), **{name: (step_of(name, 3),) for name in names}}, at_once=True
    )
    net_s, pass_s = sum(nets), together["none"]
    text = (
        f"Net of a pass-through of {1e3 * pass_s:.0f} ms (upload, evaluation, reading, rounding). "
        f"Median at severity 3: {1e3 * float(np.median(nets)):.0f} ms. "
        f"All {len(names)} in one call: {together['all']:.2f} s, which is "
        f"{together['all'] / (net_s + len(names) * pass_s):.2f} times a call for each, "
        f"and {together['all'] / (net_s + pass_s):.2f} times their net times with one pass-through."
    )
    head = ("perturbation", "nodes, severity 3, ms", "severity 5, ms", "reference, severity 3, ms")
    return "\n\n".join([text, table(head, rows)])


def building(names: Sequence[str]) -> str:
    """Time describing every group and making it in an empty file."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    start_s = time.perf_counter()
    for name in names:
        perturbation = registry()[name]
        assert isinstance(perturbation, ColourPerturbation)
        ensure_group(build_group(perturbation))
    nodes = sum(len(tree.nodes) for tree in bpy.data.node_groups)
    return f"Making all {len(names)} groups, {nodes} nodes: {time.perf_counter() - start_s:.2f} s."


def timed_in_turns(
    size_px: tuple[int, int],
    rgb: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    chains: Mapping[str, Sequence[Step]],
    *,
    at_once: bool = False,
) -> dict[str, float]:
    """Return the median seconds of each chain, taken in turns; `at_once`: of "none", and of the others in one call."""
    calls = (
        {"none": ["none"], "all": [name for name in chains if name != "none"]} if at_once else {n: [n] for n in chains}
    )
    found: dict[str, list[float]] = {name: [] for name in calls}
    with Compositor(size_px, chains, size_px[0]) as compositor:
        for turn in range(TURNS + 1):
            for name, wanted in calls.items():
                start_s = time.perf_counter()
                compositor.perturb(rgb, dict.fromkeys(wanted, (turn, (SEED, "", ""))), depth_m)
                if turn:
                    found[name].append(time.perf_counter() - start_s)
    return {name: float(np.median(values)) for name, values in found.items()}


def previews(names: Sequence[str], frames: NDArray[np.uint8]) -> str:
    """Compare a preview at half size, scaled up, with the frame; and the frame itself, scaled down and up."""
    size_px = frames.shape[2], frames.shape[1]
    half_px = size_px[0] // 2, size_px[1] // 2
    rgb, depth_m = as_float(frames[0]), slope(size_px)
    small = np.asarray(cv2.resize(rgb, half_px, interpolation=cv2.INTER_AREA), np.float32)
    small_depth_m = slope(half_px)
    rows = []
    for name in names:
        step = step_of(name, 3)
        with Compositor(size_px, {"x": [step]}, size_px[0]) as compositor:
            whole = evaluated(compositor, rgb, depth_m)
        with Compositor(half_px, {"x": [step]}, size_px[0]) as compositor:
            preview = evaluated(compositor, small, small_depth_m)
        resampled = np.asarray(cv2.resize(whole, half_px, interpolation=cv2.INTER_AREA), np.float32)
        rows.append((name, *(f"{similarity(whole, item, size_px):.3f}" for item in (preview, resampled))))
    text = f"SSIM with the frame at severity 3, of what is {half_px[0]} x {half_px[1]}, scaled up."
    return "\n\n".join([text, table(("perturbation", "preview", "frame, resampled"), rows)])


def similarity(whole: NDArray[np.float32], small: NDArray[np.float32], size_px: tuple[int, int]) -> float:
    """Return the SSIM (mean of the channels) of a frame and a small picture scaled up, both as bytes."""
    large = np.asarray(cv2.resize(small, size_px, interpolation=cv2.INTER_LINEAR), np.float32)
    ssim_of = cv2.quality.QualitySSIM_compute  # pyright: ignore[reportAttributeAccessIssue]  not in OpenCV's stubs
    values, _ = ssim_of(rgb_bytes(whole), rgb_bytes(large))
    return float(np.mean(values[:3]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
