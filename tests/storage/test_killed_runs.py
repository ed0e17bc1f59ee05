# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs at an object store and at file://, killed at random moments and begun again: the files of undisturbed ones."""

import multiprocessing
import os
import random
import signal
import time

from packed import SETTINGS, run_there, write_preset

from noisy_world.dataset.store import open_store

KILLS = 10
LOADED = (
    "noisy_world.dataset.address_run",
    "packed",
    "s3fs",
    "pyarrow.parquet",
    "cv2",
    "yaml",
    "OpenEXR",
    "deflate",
    "tqdm",
)


def start(*arguments):
    """Start a run in a process of its own, forked from one that has loaded the program and does nothing else."""
    forking = multiprocessing.get_context("forkserver")
    forking.set_forkserver_preload(list(LOADED))
    process = forking.Process(target=run_there, args=arguments)
    process.start()
    return process


def content(address):
    there = open_store(address)
    return {name: there.read(name) for name in there.sizes("") if name != "run.json"}


def test_killed_at_random_moments(store, tmp_path):
    scratch, environment = tmp_path / "scratch", dict(store.environment)
    preset = write_preset(tmp_path, frames=4, scenes=("hall",), settings=[SETTINGS[0], SETTINGS[2]])
    whole = store.bucket("undisturbed")
    process = start(preset, whole, scratch, environment)
    process.join()
    begun = time.monotonic()
    process = start(preset, store.bucket("timed"), scratch, environment)  # the first one has loaded the libraries
    process.join()
    longest_s, wanted = time.monotonic() - begun, content(whole)
    moments, killed, rounds = random.Random(14), 0, 0
    while killed < KILLS:
        rounds += 1
        address = store.bucket(f"killed-{rounds}") if rounds % 2 else f"file://{tmp_path}/killed-{rounds}/noisy"
        while True:
            process = start(preset, address, scratch, environment)
            process.join(longest_s * moments.random() if killed < KILLS else None)
            if process.exitcode is not None:
                break
            os.kill(process.pid, signal.SIGKILL)
            process.join()
            killed += 1
        assert process.exitcode == 0
        found = content(address)
        assert sorted(found) == sorted(wanted)
        assert [name for name in found if found[name] != wanted[name]] == []
        assert not list(scratch.iterdir())
        assert rounds < 5 * KILLS, "nearly every run came to its end before it was killed"
