# SPDX-License-Identifier: GPL-3.0-or-later
"""A recording beside its twin: figure by figure, and by what a SLAM system makes of both.

    python headless/bench/twin.py figures RECORDING MESH TRAJECTORY   a real sensor; the room that it saw, and its path
    python headless/bench/twin.py systems --rooms 2,5,6               a degraded recording of each embedded room

`figures` measures RECORDING, renders MESH from TRAJECTORY with its camera, puts the measured device on that and
measures it again. `systems` makes a recording with a known device, measures it, makes its twin on the same path, and
runs the embedded RGB-D odometry on both. Both print tables for docs/twin.md.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "addon")]
os.environ["PYTHONPATH"] = str(ROOT / "addon")  # of the workers

import numpy as np
import yaml

from noisy_world.cli import command
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.schema import ConfigPath
from noisy_world.measure.figure import Figure
from noisy_world.measure.footage import footage_of
from noisy_world.measure.looking import RecordingFigures, measured
from noisy_world.measure.twin import device_text, preset_text, twin_of
from noisy_world.perturbations import registry
from noisy_world.perturbations.kinds import FrameContext
from noisy_world.sources.recording import read_recording

SIDE, KEPT = 24, 0.4  # blocks of planes in pixels, and the share of the flattest that counts
DISTANCES_M = ((0.8, 1.3), (1.3, 1.8), (1.8, 2.4), (2.4, 3.2))
FRAMES = 90
CAMERA = {"width": 320, "height": 240, "fx": 250.0, "fy": 250.0, "cx": 159.5, "cy": 119.5}
KNOWN = [
    {"structured_light": {"device": "kinect_v1_measured", "min_m": 0.3, "max_m": 6.0}},
    {"gaussian_noise": {"std": 0.04}},
]
SEEDS, VOID_SEEDS = 3, 10


def main(arguments: list[str]) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="twin.py", description="A recording beside its twin.")
    parts = parser.add_subparsers(dest="part", required=True)
    figures = parts.add_parser("figures")
    for name in ("recording", "mesh", "trajectory"):
        figures.add_argument(name, type=Path)
    systems = parts.add_parser("systems")
    systems.add_argument("--rooms", default="2,5,6")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        if given.part == "figures":
            _figures(given, Path(folder))
        else:
            _systems([int(seed) for seed in given.rooms.split(",")], Path(folder))
    return 0


def _run(*words: str | Path) -> None:
    if command.main([str(word) for word in words]) != 0:
        raise SystemExit(f"{' '.join(map(str, words))} failed")


def _measured(folder: Path) -> tuple[RecordingFigures, Any]:
    """Return what a recording says of itself, and its twin."""
    source = read_recording(folder, ConfigPath("twin"))
    camera = source.camera(None)
    found = measured(folder.name, source, camera)
    return found, twin_of(found, camera, source.optics(camera).distortion)


def _preset(folder: Path, name: str, document: Mapping[str, Any]) -> Path:
    file = folder / name
    file.write_text(yaml.safe_dump(document))
    return file


# --- figure by figure ---


def _figures(given: argparse.Namespace, folder: Path) -> None:
    found, twin = _measured(given.recording)
    (folder / "twin.yaml").write_text(preset_text(twin, found))
    (setting,) = [
        each for each in yaml.safe_load((folder / "twin.yaml").read_text())["settings"] if each["name"] == "twin"
    ]
    document = {
        "scenes": [
            {"name": "room", "mesh": str(given.mesh.absolute()), "trajectory": str(given.trajectory.absolute())}
        ],
        "camera": twin.camera,
        "render": {"engine": "embree", "backend": "reference"},
        "settings": [{"name": "clean"}, {"name": "twin", "perturb": setting["perturb"]}],
        "output": {"layout": "tum", "overview": False, "depth_scale_per_m": twin.depth_scale_per_m or 1000.0},
    }
    _run("generate", _preset(folder, "preset.yaml", document), "--out", folder / "out")
    again, _ = _measured(folder / "out" / "twin" / "room")
    print("| figure | recording | its twin |\n|---|---|---|")
    for name, figure in found.figures.items():
        other = again.figures.get(name)
        if figure.value is not None or (other is not None and other.value is not None):
            print(f"| `{name}` | {_told(figure)} | {_told(other)} |")
    rows = [_planes(path) for path in (given.recording, folder / "out" / "twin" / "room")]
    print("\n| planes over 24 x 24 px, the flattest 40 % | recording | its twin |\n|---|---|---|")
    for name in dict.fromkeys([*rows[0], *rows[1]]):
        print(f"| {name} | {rows[0].get(name, '-')} | {rows[1].get(name, '-')} |")
    own = _void(folder / "out" / "clean" / "room")
    both = [
        np.mean([void[~mesh].mean() for void, mesh in zip(_void(path), own, strict=True)])
        for path in (given.recording, folder / "out" / "twin" / "room")
    ]
    print(f"| void, of what the mesh has | {100 * both[0]:.1f} % | {100 * both[1]:.1f} % |")
    if twin.sensor:
        voids = 100 * np.array(_void_by_seeds(twin, _depth(folder / "out" / "clean" / "room")))
        told = f"{voids.mean():.1f} % ({voids.min():.1f} to {voids.max():.1f}; deviation {voids.std(ddof=1):.1f})"
        print(f"| the same over {VOID_SEEDS} seeds | | {told} |")


def _void_by_seeds(twin: Any, clean_m: list[np.ndarray]) -> list[float]:
    """Return the share of void, of what the mesh has, of each seed: every fourth frame, as elsewhere here."""
    ((name, values),) = twin.sensor.items()
    model: Any = registry()[name]
    keys = twin.camera
    camera = Intrinsics(keys["width"], keys["height"], *(keys[each] for each in ("fx", "fy", "cx", "cy")))
    voids: list[float] = []
    for seed in range(VOID_SEEDS):
        frames = [FrameContext(4 * place, (seed, "twin"), intrinsics=camera) for place in range(len(clean_m))]
        seen = [
            model.apply(depth_m.astype(np.float32), model.parameters(**values), frame)
            for depth_m, frame in zip(clean_m, frames, strict=True)
        ]
        shares = [(made <= 0)[own > 0].mean() for made, own in zip(seen, clean_m, strict=True)]
        voids.append(float(np.mean(shares)))
    return voids


def _told(figure: Figure | None) -> str:
    if figure is None or figure.value is None:
        return "-"
    if figure.low is None or figure.high is None or figure.low == figure.high:
        return f"{figure.value:.3g}"
    return f"{figure.value:.3g} ({figure.low:.3g} to {figure.high:.3g})"


def _depth(folder: Path) -> list[np.ndarray]:
    source = read_recording(folder, ConfigPath("twin"))
    with footage_of(folder.name, source, source.camera(None), 1 << 16) as footage:
        return [np.asarray(footage.look(frame).depth_m, np.float64) for frame in range(0, len(footage), 4)]


def _void(folder: Path) -> list[np.ndarray]:
    return [depth_m <= 0 for depth_m in _depth(folder)]


def _planes(folder: Path) -> dict[str, str]:
    """Return deviations of pixels and of 4 x 4 means by distance, and correlations: independent of `measure`."""
    v, u = np.mgrid[:SIDE, :SIDE].reshape(2, -1)
    terms = np.stack([np.ones(u.size), u, v], axis=1)
    left = np.eye(u.size) - terms @ np.linalg.pinv(terms)
    z: list[float] = []
    rest: list[np.ndarray] = []
    for depth_m in _depth(folder):
        high, wide = (side // SIDE * SIDE for side in depth_m.shape)
        blocks = depth_m[:high, :wide].reshape(high // SIDE, SIDE, -1, SIDE).swapaxes(1, 2).reshape(-1, SIDE * SIDE)
        for block in blocks[(blocks > 0).all(axis=1)]:
            z.append(float(np.median(block)))
            rest.append(-(left @ (1 / block)) * block**2)
    at_m, residual = np.array(z), np.array(rest).reshape(-1, SIDE, SIDE)
    rough = residual.std(axis=(1, 2)) / at_m**2
    flat = rough < np.quantile(rough, KEPT)
    at_m, residual = at_m[flat], residual[flat]
    means = residual.reshape(-1, SIDE // 4, 4, SIDE // 4, 4).mean(axis=(2, 4))
    rows: dict[str, str] = {}
    for low, high in DISTANCES_M:
        here = (at_m >= low) & (at_m < high)
        if here.sum() > 20:
            pixels, blocks = (np.median(each[here].std(axis=(1, 2))) * 1e3 for each in (residual, means))
            rows[f"deviation at {low} to {high} m, of pixels and of 4 x 4 means, mm"] = f"{pixels:.2f}, {blocks:.2f}"
    square = (residual**2).mean()
    alike = [(residual[:, :, lag:] * residual[:, :, :-lag]).mean() / square for lag in (1, 2, 4)]
    rows["correlation across at 1, 2, 4 px"] = ", ".join(f"{each:.2f}" for each in alike)
    rows["void, of all pixels"] = f"{100 * np.mean([(each <= 0).mean() for each in _depth(folder)]):.1f} %"
    return rows


# --- what a system makes of both ---


def _systems(rooms: Sequence[int], folder: Path) -> None:
    scenes = [
        {
            "name": f"room{seed}",
            "mesh": f"embedded:room?seed={seed}",
            "trajectory": {"handheld": {"frames": FRAMES, "rate_hz": 30, "seed": 40 + seed}},
        }
        for seed in rooms
    ]
    head = {"camera": CAMERA, "render": {"engine": "embree", "backend": "reference"}}
    print("| room | error on the recording, mm | on its twin, mm | twin / recording |\n|---|---|---|---|")
    for scene in scenes:
        own = folder / scene["name"]
        own.mkdir()
        recorded = head | {"scenes": [scene], "settings": [{"name": "recorded", "perturb": KNOWN}]}
        recorded["output"] = {"layout": "tum", "overview": False, "depth_scale_per_m": 5000}
        _run("generate", _preset(own, "recorded.yaml", recorded), "--out", own / "recorded")
        found, twin = _measured(own / "recorded" / "recorded" / scene["name"])
        (own / "measured.yaml").write_text(device_text(twin, found))
        steps = [
            step for step in [*twin.colour, *([twin.sensor] if twin.sensor else [])] if "jpeg_compression" not in step
        ]
        both = [{"name": "recorded", "perturb": KNOWN}, {"name": "twin", "perturb": steps}]
        study = _preset(own, "study.yaml", head | {"scenes": [scene], "settings": both})
        seeds = ",".join(str(seed) for seed in range(SEEDS))
        _run("evaluate", study, "--systems", "rgbd_odometry", "--seeds", seeds, "--out", own / "results", "--no-report")
        errors = {name: _errors(own / "results", name) for name in ("recorded", "twin")}
        logs = {name: np.log(values) for name, values in errors.items()}
        ratio = logs["twin"].mean() - logs["recorded"].mean()
        wide = 2.776 * float(np.sqrt(sum(each.var(ddof=1) / len(each) for each in logs.values())))  # t of 4 degrees
        shown = [", ".join(f"{1e3 * value:.1f}" for value in errors[name]) for name in ("recorded", "twin")]
        low, middle, high = np.exp([ratio - wide, ratio, ratio + wide])
        print(f"| {scene['name']} | {shown[0]} | {shown[1]} | {middle:.2f} ({low:.2f} to {high:.2f}) |", flush=True)


def _errors(results: Path, setting: str) -> np.ndarray:
    """Return the absolute trajectory errors in metres, a seed each."""
    import pandas as pd

    table = pd.read_csv(results / "tables" / "runs.csv")
    return table[table.setting == setting].sort_values("seed").ate_rmse_m.to_numpy(np.float64)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
