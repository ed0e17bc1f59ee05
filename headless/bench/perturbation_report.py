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
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
PEER_PYTHON = ROOT / ".venv-corruptions" / "bin" / "python"
sys.path[:0] = [str(ROOT / "addon"), str(ROOT / "headless")]

from bench import node_groups, tables
from bench.contestant import Contestant
from noisy_world.core.perturbing.kinds import SEVERITIES, ColourPerturbation, DepthPerturbation
from noisy_world.perturb import apply
from noisy_world.perturbations import registry

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
        everything = [item.name for item in coloured if item.build]
        parts += ["## Node groups", node_groups.building(everything), node_groups.errors(frames)]
        parts += [node_groups.times(names, frames, reference_ms), node_groups.previews(everything, frames)]
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
    table = tables.table(("perturbation", "reference, ms", "peer, ms", "times faster"), rows)
    return "\n\n".join([text, table]), found_ms


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
    return tables.table(("perturbation of depth", "ms"), rows)


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
    return "\n\n".join([text, tables.table(head, rows)])


def measured(
    backend: str, name: str, severity: int, seed: int, *, frames: NDArray[np.uint8], peer: Contestant
) -> dict[str, float]:
    """Perturb the frames with one seed and let the peer's library measure them."""
    if backend == "compositor":
        images = node_groups.composited(frames, {"x": [node_groups.step_of(name, severity)]}, seed=seed)["x"]
    else:
        images = [apply(frame, name, severity=severity, seed=seed, frame=k) for k, frame in enumerate(frames)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "other.npy"
        np.save(path, np.stack(images))
        return peer.ask(do="metrics", file=str(path))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
