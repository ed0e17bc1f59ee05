# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs at an address against the same dataset made in a folder and published: cuttings, damage, refusals."""

import json
import os
import shutil
import sys
import threading
from pathlib import Path

import pytest
from packed import destination_of, pack_to, put_shard, run_of, write_preset
from refusals import refused

from noisy_world.cli import command
from noisy_world.cli.entry import Entry
from noisy_world.cli.shard_workers import ShardOrder, ready_for_shards
from noisy_world.core.errors import InterruptedRunError, MissingDependencyError, StorageError
from noisy_world.preset.keys import read_preset
from noisy_world.dataset import address_run
from noisy_world.dataset.address_run import AddressDestination
from noisy_world.dataset.making import Report
from noisy_world.dataset.plan import make_plan


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_same(folder, packed):
    found, wanted = files(folder), files(packed)
    assert sorted(found) == sorted(wanted)
    assert [name for name in found if found[name] != wanted[name]] in (["run.json"], [])


def missing(work, left):
    return StorageError(f"missing: {work}")


@pytest.fixture
def preset(dataset):
    return dataset.parent / "preset.json"


@pytest.fixture
def place(tmp_path):
    """A folder and its address, and a scratch folder."""
    return tmp_path / "there/noisy", f"file://{tmp_path}/there/noisy", tmp_path / "scratch"


def test_a_run_equals_a_published_folder(preset, packed, place, monkeypatch, capfd):
    folder, address, scratch = place
    monkeypatch.setattr(address_run, "SHARD_BYTES", 2000)  # several shards
    report = run_of(preset, address, scratch).make_dataset()
    assert report.frames_rendered == 12
    assert_same(folder, packed)
    assert not list(scratch.iterdir())
    marks = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert run_of(preset, address, scratch).make_dataset().frames_rendered == 0
    assert "holds this dataset already; nothing to do" in capfd.readouterr().err
    assert marks == {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


def test_a_run_that_ended_before_it_tidied_up(preset, place, monkeypatch):
    _, address, scratch = place
    with monkeypatch.context() as patched:
        patched.setattr(AddressDestination, "_remove_staging", lambda self: None)
        run_of(preset, address, scratch).make_dataset()
    assert list(scratch.iterdir())
    run_of(preset, address, scratch).make_dataset()
    assert not list(scratch.iterdir())


def test_any_cutting_and_order_of_shards(preset, packed, place):
    folder, address, scratch = place
    # Overlapping and out of order; windows of desync and faster motion cross all borders.
    names = [
        "attic.000003-000006",
        "hall.000005-000006",
        "hall.000000-000001",
        "hall.000001-000004",
        "attic.000000-000004",
    ]
    for name in names:
        put_shard(preset, address, scratch, name)
    refused(run_of(preset, address, scratch).merge, missing, names="{'hall': [4]}", error=StorageError)
    kept = files(folder)
    put_shard(preset, address, scratch, "hall.000001-000004")
    assert files(folder) == kept
    put_shard(preset, address, scratch, "hall.000004-000005")
    run_of(preset, address, scratch).merge(missing)
    assert_same(folder, packed)
    assert not list(scratch.iterdir())


def test_a_run_goes_on_from_shards_and_overview_is_the_folder_s(tmp_path, place):
    from runs import run

    folder, address, scratch = place
    preset = write_preset(tmp_path / "world", overview=True, licence="cc-by-4.0")
    run(preset, tmp_path / "out")
    pack_to(tmp_path / "out", f"file://{tmp_path}/packed/noisy")
    put_shard(preset, address, scratch, "hall.000002-000005")
    report = run_of(preset, address, scratch).make_dataset()
    assert (report.frames_rendered, report.frames_kept) == (9, 3)
    assert_same(folder, tmp_path / "packed/noisy")
    assert json.loads((folder / "croissant.json").read_text())["license"] == "cc-by-4.0"
    assert "license: cc-by-4.0\n" in (folder / "README.md").read_text()


def test_workers_elsewhere_put_shards_themselves(preset, packed, place):
    # As a node of a cluster does it: an order with the address, then a shard's name.
    folder, address, scratch = place
    plan = make_plan(read_preset(preset))
    order, put = ShardOrder.of(plan, address, 1, scratch, merging=False).text(), []

    def workers(shards, made, progress):
        for shard in shards:
            with ready_for_shards(order, progress, stop=threading.Event()) as perform:
                perform(shard.name)
            made(shard)
            put.append(shard)
        return Report()

    run_of(preset, address, scratch, workers=workers, shards=5, put_by_workers=True).make_dataset()
    assert len(put) == 5
    for scene in ("attic", "hall"):
        assert [k for shard in put if shard.render == scene for k in range(shard.start, shard.stop)] == list(range(6))
    assert_same(folder, packed)
    assert not list(scratch.iterdir())


def test_a_damaged_shard_is_made_again(preset, packed, place):
    folder, address, scratch = place
    for name in ("hall.000000-000006", "attic.000000-000006"):
        put_shard(preset, address, scratch, name)
    tar = folder / ".noisy_world/shards/hall.000000-000006.tar"
    data = bytearray(tar.read_bytes())
    at = data.index(b"IDAT") + 8
    data[at] ^= 1
    tar.write_bytes(data)
    named = ("hall.000000-000006.tar: ", "is not as it was written", "dropped")
    refused(run_of(preset, address, scratch).merge, missing, names=named, error=StorageError)
    assert run_of(preset, address, scratch).make_dataset().frames_rendered == 6
    assert_same(folder, packed)


@pytest.mark.parametrize("name", ["identity.json", "shards/hall.000000-000006.json", "shards/hall.000000-000006.tar"])
def test_torn_files_do_not_count(name, preset, packed, place):
    folder, address, scratch = place
    put_shard(preset, address, scratch, "hall.000000-000006")
    path = folder / ".noisy_world" / name
    path.write_bytes(path.read_bytes()[:-100])
    if name == "identity.json":
        refused(run_of(preset, address, scratch).make_dataset, names="identity.json: ", error=StorageError)
        path.unlink()
    run_of(preset, address, scratch).make_dataset()
    assert_same(folder, packed)


def test_interrupted_runs_go_on(preset, packed, place, monkeypatch):
    folder, address, scratch = place
    monkeypatch.setattr(address_run, "SHARD_BYTES", 2000)

    class After(threading.Event):
        def __init__(self, looks):
            super().__init__()
            self.looks = looks

        def is_set(self):
            self.looks -= 1
            return self.looks < 0

    for looks in range(3, 60, 4):
        try:
            run_of(preset, address, scratch, stop=After(looks)).make_dataset()
            break
        except InterruptedRunError:
            assert not (folder / "manifest.json").exists()
    else:
        pytest.fail("no run came to its end")
    assert looks > 3
    assert_same(folder, packed)


def test_what_is_refused_at_an_address(preset, place, tmp_path):
    folder, address, scratch = place

    def differs(*names, preset=preset, **options):
        said = refused(run_of(preset, address, scratch, **options).make_dataset, names=names, error=StorageError)
        assert said.startswith(address)

    put_shard(preset, address, scratch, "hall.000000-000003")
    begun = "another dataset is being made there: "
    differs(begun, "seed was 5, is 6", overrides=["seed=6"])
    differs(begun, "--frames was not given, is 0:2", frames=slice(0, 2))
    severity = "settings.1.perturb.0.gaussian_noise.severity=1"
    differs(begun, "noise (gaussian_noise.severity) was 3, is 1", overrides=[severity])
    run_of(preset, address, scratch).make_dataset()
    sealed = "holds another dataset: "
    differs(sealed, "seed was 5, is 6", "does not grow", overrides=["seed=6"])
    differs(sealed, "clean/attic has 6 frames, not 2", frames=slice(0, 2))
    other = json.loads(preset.read_text())
    other["settings"].append({"name": "more", "perturb": [{"brightness": {"severity": 1}}]})
    (preset.parent / "more.json").write_text(json.dumps(other))
    differs(sealed, "more", preset=preset.parent / "more.json")
    refused(put_shard, preset, f"{address}2", scratch, "cellar.000000-000003", names="cellar")
    # A shard that somebody copied from another dataset's address.
    name = "hall.000000-000003"
    for number, keys in ((3, ()), (4, ["seed=6"])):
        put_shard(preset, f"{address}{number}", scratch, name, overrides=keys)
    for file in Path(f"{folder}4/.noisy_world/shards").iterdir():
        shutil.copy(file, Path(f"{folder}3/.noisy_world/shards", file.name))
    names = (f"{address}3/", name, "does not belong to the dataset: ", "remove")
    refused(run_of(preset, f"{address}3", scratch).make_dataset, names=names, error=StorageError)
    shutil.rmtree(folder)


def test_without_what_writes_the_table_nothing_is_begun(preset, dataset, place, monkeypatch, capsys):
    folder, address, scratch = place
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    named = ("needs pyarrow", "[cloud]")
    refused(run_of(preset, address, scratch).make_dataset, names=named, error=MissingDependencyError)
    refused(pack_to, dataset, address, names=named, error=MissingDependencyError)
    assert command.run("generate", [str(preset), "--out", address, "--dry-run"], Entry("generate", ("generate",))) == 1
    said = capsys.readouterr().err
    assert all(name in said for name in named)
    assert not folder.exists() or not list(folder.rglob("*"))


def test_a_scratch_folder_of_somebody_else_is_refused(preset, place, tmp_path, monkeypatch):
    _, address, scratch = place
    _, there = destination_of(preset, address, scratch)
    scratch.mkdir()
    (tmp_path / "theirs").mkdir()
    there.folder.parent.symlink_to(tmp_path / "theirs")
    run, named = run_of(preset, address, scratch), (str(scratch), "user's own", "--scratch")
    refused(run.make_dataset, names=named, error=StorageError)
    there.folder.parent.unlink()
    there.folder.parent.mkdir()
    if sys.platform != "win32":
        other = os.geteuid() + 1
        with monkeypatch.context() as patched:
            patched.setattr(os, "geteuid", lambda: other)
            refused(run_of(preset, address, scratch).make_dataset, names=named, error=StorageError)
    file = tmp_path / "world.txt"
    file.touch()
    refused(lambda: run_of(preset, address, file).make_dataset(), names=(str(file), "written"), error=StorageError)
