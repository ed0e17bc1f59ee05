# SPDX-License-Identifier: GPL-3.0-or-later
"""A small dataset of recordings, which need no Blender, and addresses to pack it to."""

import json
import os
import sys
import threading

import cv2
import numpy as np
from worlds import path_poses, write_replica

from noisy_world.core.progress import PlainProgress

CAMERA = {"width": 16, "height": 12, "fx": 8.0, "fy": 8.0, "cx": 7.5, "cy": 5.5}
SETTINGS = [
    {"name": "clean"},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}, {"depth_gaussian_noise": {"severity": 2}}]},
    {"name": "late", "perturb": [{"desync": {"offset": 2, "edge": "drop"}}]},
    {"name": "fast.x2", "perturb": [{"faster_motion": {"factor": 2}}]},
]


def write_recording(folder, *, frames=6, size=(16, 12), number=0):
    """Write a recording in Replica's layout, each image of one value with a mark that moves. number: tells it apart."""
    (folder / "results").mkdir(parents=True)
    for k in range(frames):
        colour = np.full((size[1], size[0], 3), (40 * k, 90 + number, 200 - 20 * k), np.uint8)
        colour[k % size[1], :4] = 255
        assert cv2.imwrite(str(folder / f"results/frame{k:06d}.png"), colour)
        depth = np.full((size[1], size[0]), 6000 + 1000 * k + number, np.uint16)
        depth[:2, k] = 0
        assert cv2.imwrite(str(folder / f"results/depth{k:06d}.png"), depth)
    write_replica(folder / "traj.txt", path_poses(frames))


def write_preset(folder, *, frames=6, scenes=("hall", "attic"), settings=SETTINGS, **output):
    """Write recordings and a preset of them; return the preset's path."""
    for number, scene in enumerate(scenes):
        write_recording(folder / "in" / scene, frames=frames, number=number)
    preset = {
        "seed": 5,
        "scenes": [{"name": scene, "sequence": f"in/{scene}"} for scene in scenes],
        "camera": CAMERA,
        "render": {"backend": "reference"},
        "settings": settings,
        "output": {"layout": "replica", "image": "png", **output},
    }
    path = folder / "preset.json"
    path.write_text(json.dumps(preset))
    return path


def pack_to(dataset, address):
    from noisy_world.dataset.store import open_store
    from noisy_world.dataset.packing import publish

    return publish(dataset, open_store(address), PlainProgress(sys.stderr), threading.Event())


def destination_of(preset, address, scratch, *, frames=None, overrides=(), **options):
    """Return a preset's plan and the address as where it goes."""
    from noisy_world.preset.keys import read_preset
    from noisy_world.dataset.address_run import AddressDestination
    from noisy_world.dataset.plan import make_plan
    from noisy_world.dataset.store import open_store

    plan = make_plan(read_preset(preset, overrides), frames)
    return plan, AddressDestination(plan, open_store(address), scratch, **options)


def run_of(preset, address, scratch, *, stop=None, workers=None, shards=None, **options):
    """Return a run of a preset at an address."""
    from noisy_world.dataset.run import Run

    plan, place = destination_of(preset, address, scratch, **options)
    stop, progress = stop or threading.Event(), PlainProgress(sys.stderr)
    return Run(plan, place, progress=progress, stop=stop, workers=workers, shards=shards)


def put_shard(preset, address, scratch, name, **options):
    """Make a shard and put it to an address."""
    from noisy_world.dataset.shards import Shard

    _, place = destination_of(preset, address, scratch, **options)
    with place.making(PlainProgress(sys.stderr), threading.Event()) as make:
        return make(Shard.parse(name))


def run_there(preset, address, scratch, environment):
    """Make a dataset at an address, in many small shards."""
    from noisy_world.dataset import address_run

    os.environ.update(environment)
    address_run.SHARD_BYTES = 2000
    run_of(preset, address, scratch).make_dataset()
