# SPDX-License-Identifier: GPL-3.0-or-later
"""Ends a run before each single call to the file system, resumes it and compares with an undisturbed dataset.

    python tests/pipeline/crash_every_step.py PRESET UNDISTURBED FOLDER [FINISHED [merge | SHARD]]

FINISHED: a dataset that the run adds to; none of its images may be touched. merge: the dataset is one of finished
shards, and they are merged. SHARD: this shard is made in it, and all are merged when that has come to its end. Prints
the number of steps; fails with an AssertionError. Frames come from fake_session: the files are what is tried.
"""

import hashlib
import os
import shutil
import sys
import threading
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "support"), str(HERE.parents[1] / "addon")]

import fake_session
from worlds import content

from noisy_world.dataset.plan import make_plan
from noisy_world.preset.keys import read_preset
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.shards import Shard
from noisy_world.dataset.run import Run, ShardMaker
from noisy_world.dataset.shards import shard_folder

sys.modules["noisy_world.render.mesh_session"] = fake_session

CALLS = ("replace", "hardlink_to", "unlink", "mkdir", "rmdir", "write_bytes", "open")


def run(preset, out):
    with Path(os.devnull).open("w") as log:
        plan = make_plan(read_preset(preset))
        Run(plan, out, progress=PlainProgress(log), stop=threading.Event()).make_dataset()


def merge(preset, out):
    with Path(os.devnull).open("w") as log:
        plan = make_plan(read_preset(preset))
        Run(plan, out, progress=PlainProgress(log), stop=threading.Event()).merge(lambda work, _: ValueError(work))


def make(preset, out, name):
    with Path(os.devnull).open("w") as log:
        plan, shard = make_plan(read_preset(preset)), Shard.parse(name)
        with ShardMaker(plan, progress=PlainProgress(log), stop=threading.Event()) as maker:
            maker.make(shard_folder(out, shard), shard)


def crash_at(step, work):
    """Run `work` in a child that ends, as if killed, before its step-th call; return whether it came to its end."""
    child = os.fork()
    if child:
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        assert status in (0, 9), f"status {status} at step {step}"
        return status == 0
    counter = iter(range(10**9))
    lock = threading.Lock()

    def wrapped(function):
        def call(*arguments, **options):
            with lock:
                if next(counter) == step:
                    os._exit(9)
            return function(*arguments, **options)

        return call

    for name in CALLS:
        setattr(Path, name, wrapped(getattr(Path, name)))
    try:
        work()
    except BaseException:  # noqa: BLE001 - the parent has to see it
        os._exit(1)
    os._exit(0)


def images_of(out):
    return {str(path.relative_to(out)): path.stat().st_mtime_ns for path in out.glob("*/box/results/*")}


def main(preset, undisturbed, folder, finished_before=None, shard=None):
    work = run if shard is None else merge if str(shard) == "merge" else partial(make, name=str(shard))
    whole = content(undisturbed)
    step, finished = 0, False
    while not finished:
        out = folder / f"crashed-{step}"
        if finished_before:
            shutil.copytree(finished_before, out)
        before = images_of(out)
        finished = crash_at(step, lambda out=out: work(preset, out))
        assert before.items() <= images_of(out).items(), f"step {step} touched what was there"
        for path in out.glob("*/box/results/*"):
            digest = hashlib.sha256(path.read_bytes()).hexdigest()
            assert digest == whole[str(path.relative_to(out))], f"{path} is not whole"
        work(preset, out)
        if shard is not None and work is not merge:
            merge(preset, out)
        assert content(out) == whole, f"after a crash before step {step}"
        assert before.items() <= images_of(out).items(), f"resuming after step {step} touched what was there"
        shutil.rmtree(out)
        step += 1
    print(step)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
