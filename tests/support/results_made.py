# SPDX-License-Identifier: GPL-3.0-or-later
"""Results folders as `noisy-world evaluate` leaves them, made by arithmetic, for the report's tests.

Three systems on three scenes: `rgbd_odometry` hardly minds what is done, `my_system` drifts with the severity,
`orb_slam3` fails from severity 3 on. Every number follows from names and severity.
"""

import csv
import json
import math
import zlib
from pathlib import Path

import cv2
import numpy as np

from noisy_world.core.trajectory import Trajectory
from noisy_world.evaluate import analyses, report
from noisy_world.evaluate.estimates import Estimate
from noisy_world.evaluate.pose_errors import frame_errors_text
from noisy_world.evaluate.trajectory_scores import score_trajectory

SYSTEMS = {"rgbd_odometry": 0.002, "my_system": 0.02, "orb_slam3": 0.01}
SCENES = ("room0", "room1", "room2")
SETTINGS = (
    ("clean", "clean", "", None, {}),
    ("gaussian_noise_s1_static", "gaussian_noise", "static", 1, {}),
    ("gaussian_noise_s3_static", "gaussian_noise", "static", 3, {}),
    ("gaussian_noise_s5_static", "gaussian_noise", "static", 5, {}),
    ("frost_s5_static", "frost", "static", 5, {}),
    ("frost_s5_dynamic", "frost", "dynamic", 5, {}),
    ("depth_gaussian_noise_s3", "depth_gaussian_noise", "static", 3, {}),
    ("speed_x2", "faster_motion", "", None, {"factor": 2}),
)
FRAMES = 40
FRAME_S = 0.05
# Of the metrics those that the report goes by: each one more takes the analyses time.
METRICS = ("ate_rmse_m", "rpe_1s_rmse_m", "tracked_share", "success_10cm", "success_auc", "f1_auc")
SMALL = {
    "systems": ("rgbd_odometry", "orb_slam3"),
    "scenes": ("room0", "room1"),
    "settings": tuple(SETTINGS[k] for k in (0, 1, 3, 5, 7)),
    "seeds": ("1",),
}


def make_results(
    folder, *, systems=tuple(SYSTEMS), scenes=SCENES, settings=SETTINGS, seeds=("1", "2"), all_failed=False, skip=()
):
    """Make a results folder. skip: (scene, setting, seed, system) of runs that are missing."""
    run_rows, sequence_rows = [], []
    for scene in scenes:
        for name, perturbation, mode, severity, _ in settings:
            for seed in seeds if perturbation in ("gaussian_noise", "frost") else seeds[:1]:
                said = {"scene": scene, "setting": name, "perturbation": perturbation, "mode": mode}
                said |= {"severity": "" if severity is None else severity, "seed": seed}
                truth = _truth(scene)
                sequence_rows.append(_sequence(folder / "sequences" / scene / name / f"seed-{seed}", truth, said))
                for system in systems:
                    if (scene, name, seed, system) in skip:
                        continue
                    for repeat in range(1, 3 if system == "my_system" else 2):
                        where = folder / "runs" / scene / name / f"seed-{seed}" / system / f"repeat-{repeat}"
                        run_rows.append(_run(where, truth, {**said, "system": system, "repeat": repeat}, all_failed))
    _write_tables(folder, run_rows, sequence_rows)
    steps = {
        name: [] if name == "clean" else [_step(perturbation, mode, severity, parameters)]
        for name, perturbation, mode, severity, parameters in settings
    }
    study = {
        "systems": {name: f"{zlib.crc32(name.encode()):08x}" * 8 for name in systems},
        "protocol": "strict",
        "repeats": 2,
        "seeds": [int(seed) for seed in seeds],
        "subject": {"seed": 5, "settings": {name: {"steps": steps[name]} for name in steps}},
    }
    write_study(folder, **study)
    return folder


def without_analyses(monkeypatch):
    """Leave the analyses, which take most of a report's time, with nothing to analyse."""
    analyse = analyses.analyse
    monkeypatch.setattr(analyses, "analyse", lambda runs, sequences: analyse(runs.head(0), sequences.head(0)))


def without_pictures(monkeypatch, *, of_runs=True):
    """Leave the pictures of a report out, which take most of the rest. of_runs: those of single runs, too."""
    if of_runs:
        monkeypatch.setattr(report, "_run_pictures", lambda *_: [])
    monkeypatch.setattr(report, "_heat_map", lambda *_: None)
    monkeypatch.setattr(report, "ranking_picture", lambda *_: None)


def write_study(folder, **keys):
    """Write the study.json of a study of nothing, but for these keys."""
    study = {"systems": {}, "protocol": "strict", "repeats": 1, "seeds": [1], "subject": {"settings": {}}, **keys}
    document = {"kind": "study of Noisy World", "format": 1, "study": study}
    (folder / "study.json").write_text(json.dumps(document, indent=1, sort_keys=True))


def write_runs(folder, rows, **keys):
    """Write runs.csv of rows, and `write_study`'s study.json."""
    (folder / "tables").mkdir(parents=True)
    with (folder / "tables" / "runs.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    write_study(folder, **keys)


def _step(perturbation, mode, severity, parameters):
    levels = [1, 2, 3, 4, 5] if mode == "dynamic" else None
    each = parameters if levels is None else [parameters] * len(levels)
    return {"name": perturbation, "severity": severity, "levels": levels, "parameters": each}


def _truth(scene):
    angle = np.linspace(0.0, 1.8 * math.pi, FRAMES)
    c2w = np.tile(np.eye(4), (FRAMES, 1, 1))
    radius = 1.0 + 0.3 * (zlib.crc32(scene.encode()) % 3)
    c2w[:, :3, 3] = np.stack([radius * np.cos(angle), np.sin(angle), 0.2 * np.sin(3 * angle)], axis=1)
    cos, sin = np.cos(angle), np.sin(angle)
    c2w[:, 0, 0], c2w[:, 0, 1], c2w[:, 1, 0], c2w[:, 1, 1] = cos, -sin, sin, cos
    return Trajectory(c2w, FRAME_S * np.arange(FRAMES))


def _sequence(folder, truth, said):
    (folder / "thumbs").mkdir(parents=True)
    stamps_s, c2w = truth.stamps_s, truth.c2w
    positions = zip(stamps_s, c2w[:, :3, 3].tolist(), strict=True)
    lines = [f"{stamp_s:.9f} {x!r} {y!r} {z!r} 0.0 0.0 0.0 1.0\n" for stamp_s, (x, y, z) in positions]
    (folder / "truth.txt").write_text("".join(lines))
    random = np.random.default_rng(zlib.crc32(said["setting"].encode()))
    severity = np.full(FRAMES, float(said["severity"] or 0))
    if said["mode"] == "dynamic":
        severity = random.integers(1, 6, FRAMES).astype(float)
    tracked = np.where(np.arange(FRAMES) % 8 == 0, 400.0 - 70.0 * severity, np.nan)
    with (folder / "frames.csv").open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["index", "stamp_s", "orb_tracked", f"severity_{said['perturbation']}"])
        for k in range(FRAMES):
            rows.writerow([k, f"{stamps_s[k]:.9f}", "" if math.isnan(tracked[k]) else tracked[k], severity[k]])
    for k in (0, FRAMES // 2):
        clean = np.full((24, 32, 3), 160, np.uint8)
        noisy = np.clip(clean + random.normal(0, 12 * severity[k], clean.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / "thumbs" / f"{k:06d}.jpg"), np.concatenate([clean, noisy], axis=1))
    mean = float(np.nanmean(tracked))
    (folder / "indicators.json").write_text(json.dumps({"orb_tracked_mean": mean}))
    return {**said, "frames": FRAMES, "orb_tracked_mean": mean}


def _run(folder, truth, said, all_failed):
    folder.mkdir(parents=True)
    severity = float(said["severity"] or 0)
    random = np.random.default_rng(zlib.crc32("/".join(str(value) for value in said.values()).encode()))
    failed = all_failed or (said["system"] == "orb_slam3" and severity >= 3)
    outcome = ("crashed" if random.random() < 0.5 else "no_estimate") if failed else "finished"
    c2w, kept = truth.c2w.copy(), np.ones(FRAMES, bool)
    drift = SYSTEMS.get(said["system"], 0.05) * (1 + 2 * severity) * (1 + 0.2 * random.random())
    c2w[:, :3, 3] += drift * np.cumsum(random.normal(0, 0.3, (FRAMES, 3)), axis=0)
    if severity >= 3:
        kept[FRAMES // 2 : FRAMES // 2 + 4] = False
    estimate = Estimate(truth.stamps_s[kept][: 0 if failed else None], c2w[kept][: 0 if failed else None])
    strict, paper = score_trajectory(estimate, truth), score_trajectory(estimate, truth, "paper")
    (folder / "errors.csv").write_text(frame_errors_text(strict.frame_errors))
    scores = {"failure": strict.failure, "strict": strict.values, "paper": paper.values}
    (folder / "scores.json").write_text(json.dumps(scores, indent=1))
    seconds = 1.0 + random.random()
    measured = {"frames": FRAMES, "seconds": seconds, "processor_s": 2 * seconds, "peak_memory_bytes": 10**8}
    record = {"system": said["system"], "outcome": outcome, "detail": "", **measured}
    (folder / "run.json").write_text(json.dumps({**record, "versions": {said["system"]: "1.0"}}))
    paper_values = {f"paper.{name}": value for name, value in paper.values.items()}
    values = {name: strict.values[name] for name in METRICS}
    return {**said, "outcome": outcome, "failure": strict.failure, **measured, **values, **paper_values}


def _write_tables(folder, run_rows, sequence_rows):
    (folder / "tables").mkdir()
    for name, rows in (("runs", run_rows), ("sequences", sequence_rows)):
        with Path(folder / "tables" / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows({key: "" if value is None else value for key, value in row.items()} for row in rows)
