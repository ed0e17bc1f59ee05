# SPDX-License-Identifier: GPL-3.0-or-later
"""What weather and dirt do to SLAM: features and paths under each, beside the benchmark's versions.

python headless/bench/weather_table.py RESULTS    evaluates a small study into RESULTS and prints its table
"""

import argparse
import csv
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HEADLESS = Path(__file__).parents[1]
SYSTEM = "rgbd_odometry"
# Named as in presets: ours that follow depth or the lens, each beside what the benchmark has of its kind.
KINDS = {
    "fog": ("fog", "fog_depth", "haze"),
    "snow": ("snow", "snow_depth"),
    "rain, drops": ("spatter", "rain_depth", "lens_drops"),
    "ice, dirt": ("frost", "lens_frost", "lens_dirt"),
}
# A camera's world differs from the tables': an uneven fog, thin enough for a room.
OTHERS: Mapping[str, Mapping[str, Any]] = {
    "fog_depth_uneven": {"fog_depth": {"severity": 3, "unevenness": 0.6, "falloff_m": 1.5, "temporal": "drift"}}
}


def main(arguments: list[str]) -> int:
    """Run the study, or take it up again, and print its table."""
    parser = argparse.ArgumentParser(prog="weather_table.py", description="Tabulate what weather does to SLAM.")
    parser.add_argument("results", type=Path, help="folder of the study")
    parser.add_argument("--frames", type=int, default=80, help="of the path in the embedded room")
    given = parser.parse_args(arguments)
    given.results.mkdir(parents=True, exist_ok=True)
    preset = given.results / "preset.yaml"
    preset.write_text(preset_text(given.frames), encoding="utf-8")
    study = given.results / "study"
    options = ["--systems", SYSTEM, "--out", str(study), "--no-report", "--jobs", "1"]
    subprocess.run([sys.executable, str(HEADLESS / "evaluate.py"), str(preset), *options], check=True)
    print(table(study / "tables"))
    return 0


def preset_text(frames: int) -> str:
    """Return the study as a preset: a room, and every perturbation that is there at severity 3; patterns drift."""
    sys.path.insert(0, str(HEADLESS.parent / "addon"))
    from noisy_world.perturbations import registry  # importable only now

    settings: dict[str, Mapping[str, Any]] = {"clean": {}}
    for names in KINDS.values():
        for name in names:
            if (item := registry().get(name)) is not None:
                drifts = {"temporal": "drift"} if "drift" in item.temporals else {}
                settings[name] = {name: {"severity": 3, **drifts}}
    lines = [
        f"seed: 1\nscenes:\n  - {{name: room, mesh: 'embedded:room', trajectory: {{handheld: {{frames: {frames}, "
        "rate_hz: 20, seed: 1, speed_m_s: 0.4}}}",
        "camera: {width: 320, height: 240, fx: 277, fy: 277, cx: 159.5, cy: 119.5}",
        "render: {engine: embree, backend: reference}",
        "settings:",
        *(f"  - {_setting(name, steps)}" for name, steps in (settings | dict(OTHERS)).items()),
        "output: {layout: tum}",
    ]
    return "\n".join(lines) + "\n"


def _setting(name: str, steps: Mapping[str, Any]) -> str:
    if not steps:
        return f"{{name: {name}}}"
    ((kind, values),) = steps.items()
    return (
        f"{{name: {name}, perturb: [{{{kind}: {{{', '.join(f'{key}: {value}' for key, value in values.items())}}}}}]}}"
    )


def table(folder: Path) -> str:
    """Return the table of a study: a row a setting. folder: of its tables."""
    sequences = {row["setting"]: row for row in _rows(folder / "sequences.csv")}
    runs = {row["setting"]: row for row in _rows(folder / "runs.csv")}
    names = ["clean", *(name for some in KINDS.values() for name in some), *OTHERS]
    lines = ["| setting | ORB features | found again | ATE, mm |", "|---|---|---|---|"]
    for name in [name for name in names if name in runs]:
        run, seen = runs[name], sequences[name]
        ate = f"{1e3 * float(run['ate_rmse_m']):.2f}" if run["ate_rmse_m"] else run["failure"]
        found, again = (float(seen[f"{key}_mean"]) for key in ("orb_found", "orb_tracked"))
        lines.append(f"| `{name}` | {found:.0f} | {again:.0f} | {ate} |")
    return "\n".join(lines)


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
