# SPDX-License-Identifier: GPL-3.0-or-later
"""A small dataset of many settings, made of frames that need no Blender."""

import json
import sys
import threading

from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.run import ShardMaker

SETTINGS = [
    {"name": "clean"},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}]},
    {"name": "varied", "stream": "noise", "perturb": [{"gaussian_noise": {"severity": 5, "mode": "dynamic"}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 2}}]},
    {"name": "early", "perturb": [{"desync": {"offset": -1, "edge": "drop"}}]},
    {"name": "fast", "perturb": [{"faster_motion": {"factor": 3}}]},
    {"name": "shaky", "perturb": [{"motion_deviation": {"rotation_deg": 3, "translation_m": 0.05}}]},
    {
        "name": "mixed",
        "perturb": [
            {"desync": {"offset": 1}},
            {"depth_random_missing": {"severity": 3}},
            {"jpeg_compression": {"severity": 2}},
            {"gaussian_noise": {"severity": 1}},
            {"faster_motion": {"factor": 2}},
        ],
    },
    {"sweep": {"perturb": ["brightness"], "severities": [1, 3], "modes": ["static", "dynamic"]}},
]
COUNT = 8


def make_shard(plan, folder, shard, *, stop=None, there=None):
    """Make a shard in a folder, which may be anywhere."""
    with ShardMaker(plan, progress=PlainProgress(sys.stderr), stop=stop or threading.Event()) as maker:
        return maker.make(folder, shard, there)


def image(out, setting, kind, frame, suffix="png"):
    return out / setting / "box" / "results" / f"{kind}{frame:06d}.{suffix}"


def numbers(out, setting, kind):
    return sorted(int(path.stem[-6:]) for path in (out / setting / "box/results").glob(f"{kind}*"))


def records(out, setting):
    return [json.loads(line) for line in (out / setting / "box" / "frames.jsonl").read_text().splitlines()]
