# SPDX-License-Identifier: GPL-3.0-or-later
"""Publishing to an object store, reading from it, and what its refusals say."""

import json
import re

import numpy as np
import pytest
from packed import pack_to

from noisy_world.cli import command
from noisy_world.cli.entry import Entry
from noisy_world.core.errors import InputError, MissingDependencyError, StorageError
from noisy_world.dataset.store import open_store

ENTRY = Entry("noisy-world publish", ("noisy-world", "publish"))


def refusal(text, dataset):
    with pytest.raises(StorageError) as caught:
        pack_to(dataset, text)
    said = str(caught.value)
    assert said.startswith(text)
    assert "\n" not in said
    return said


def test_publish_puts_what_a_folder_would_hold(store, dataset, packed, capfd):
    address = store.bucket("published")
    assert command.run("publish", [str(dataset), address], ENTRY) == 0
    assert capfd.readouterr().out == f"wrote {address}: 8 tars, 38 frames\n"
    there = open_store(address)
    names = {str(path.relative_to(packed)) for path in packed.rglob("*") if path.is_file()}
    assert set(there.sizes("")) == names
    for name in names:
        assert there.read(name) == (packed / name).read_bytes(), name
    assert command.run("publish", [str(dataset), address], ENTRY) == 0
    assert capfd.readouterr().out == f"{address}: holds this dataset already; nothing to do\n"


def test_datasets_streams_from_the_store(store, dataset):
    hub = pytest.importorskip("datasets", reason="datasets is not installed")
    pytest.importorskip("PIL", reason="Pillow is not installed")
    address = store.bucket("streamed")
    pack_to(dataset, address)
    there = open_store(address)
    tars = [there.fs.sign(there.path(f"noise/{scene}.tar")) for scene in ("attic", "hall")]
    stream = hub.load_dataset("webdataset", data_files={"train": tars}, split="train", streaming=True)
    frames = list(stream)
    assert [(frame["json"]["scene"], frame["json"]["frame"]) for frame in frames] == [
        (scene, number) for scene in ("attic", "hall") for number in range(6)
    ]
    assert np.asarray(frames[0]["rgb.png"]).shape == (12, 16, 3)


@pytest.mark.parametrize("kind", ["store", "folder"])
def test_what_an_upload_left_does_not_count(kind, store, dataset, tmp_path):
    there = open_store(store.bucket("torn") if kind == "store" else f"file://{tmp_path}/torn")
    with pytest.raises(KeyboardInterrupt):
        interrupted(there)
    assert there.sizes("") == {}
    # Elsewhere than in an object store a killed process may leave a part under the name: without a note it is no tar.
    pack_to(dataset, there.text)
    whole = there.read("clean/hall.tar")
    manifest = there.read("manifest.json")
    there.remove("manifest.json")
    there.write("clean/hall.tar", whole[:1000])
    assert "is not empty and holds no dataset" in refusal(there.text, dataset)
    begun = {"identity": {**json.loads(manifest)["identity"], "seed": 6}, "chosen": None}
    there.write(".noisy_world/identity.json", json.dumps(begun).encode())
    assert "another dataset is being made there" in refusal(there.text, dataset)
    begun["identity"]["seed"] = 5
    there.write(".noisy_world/identity.json", json.dumps(begun).encode())
    assert pack_to(dataset, there.text).new
    assert kind == "store" or not (tmp_path / "torn/.noisy_world").exists()
    assert (there.read("clean/hall.tar"), there.read("manifest.json")) == (whole, manifest)
    assert there.sizes(".noisy_world") == {}


def test_refusals_of_the_store(store, dataset, monkeypatch, tmp_path):
    assert re.search(
        "it is not there .*; make the bucket or folder first", refusal("s3://no-such-bucket/noisy", dataset)
    )
    assert "names no place" in refusal("s3://", dataset)
    assert "Protocol not known: xyz" in refusal("xyz://place/noisy", dataset)
    with pytest.raises(MissingDependencyError, match=r"^gs://b/noisy: needs gcsfs.* -m pip install gcsfs$"):
        open_store("gs://b/noisy")
    there = open_store(store.bucket("taken"))
    there.write("notes.txt", b"somebody's")
    assert "is not empty and holds no dataset of Noisy World" in refusal(there.text, dataset)
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    assert re.search("there are no credentials .*; set them", refusal("s3://taken/noisy", dataset))


def test_a_store_that_refuses_or_does_not_answer(store, dataset, monkeypatch):
    from botocore.exceptions import ClientError
    from s3fs import S3FileSystem

    address = store.bucket("refusing")

    async def refuse(self, path, data, **options):
        raise PermissionError("Access Denied")

    monkeypatch.setattr(S3FileSystem, "_pipe_file", refuse)
    assert "access is refused (Access Denied); the credentials have to allow" in refusal(address, dataset)

    async def fail(self, path, data, **options):
        raise ClientError({"Error": {"Code": "SlowDown", "Message": "reduce your rate"}}, "PutObject")

    monkeypatch.setattr(S3FileSystem, "_pipe_file", fail)
    assert "SlowDown" in refusal(address, dataset)
    monkeypatch.undo()
    for name, value in store.environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setattr(S3FileSystem, "retries", 1)
    assert "the store does not answer" in refusal(address, dataset)


def test_what_publish_refuses_of_the_folder(dataset, tmp_path):
    import shutil

    target = f"file://{tmp_path}/packed"
    assert "holds no dataset of Noisy World" in str(failed(tmp_path, target))
    copy = tmp_path / "copy"
    shutil.copytree(dataset, copy)
    image = copy / "noise/hall/results/frame000002.png"
    image.write_bytes(image.read_bytes()[:-1])
    assert str(image) in str(failed(copy, target))
    shutil.copy(dataset / "noise/hall/results/frame000002.png", image)
    # The tars before the damaged one stay, and the same command goes on from there.
    kept = (tmp_path / "packed/clean/attic.tar").stat().st_mtime_ns
    assert pack_to(copy, target).new
    assert (tmp_path / "packed/clean/attic.tar").stat().st_mtime_ns == kept


def interrupted(there):
    with there.writing("clean/hall.tar") as sink:
        sink.write(bytes(40 * 2**20))
        raise KeyboardInterrupt


def failed(folder, target):
    with pytest.raises((InputError, StorageError)) as caught:
        pack_to(folder, target)
    return caught.value
