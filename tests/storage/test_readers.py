# SPDX-License-Identifier: GPL-3.0-or-later
"""Packed datasets as strangers stream them: webdataset, datasets, mlcroissant, pandas."""

import json
import re

import cv2
import numpy as np
import pytest


def stored(dataset, sequence):
    """The frames of a sequence of a folder: number, colour (RGB), depth in metres, as OpenCV reads them."""
    for line in (dataset / sequence / "frames.jsonl").read_text().splitlines():
        number = json.loads(line)["frame"]
        rgb = cv2.imread(str(dataset / sequence / f"results/frame{number:06d}.png"))[..., ::-1]
        depth = cv2.imread(str(dataset / sequence / f"results/depth{number:06d}.png"), cv2.IMREAD_UNCHANGED)
        yield number, rgb, depth / 6553.5


def test_the_card_s_reader_gives_colour_depth_and_pose(dataset, packed, monkeypatch):
    pytest.importorskip("webdataset", reason="webdataset is not installed")
    pytest.importorskip("PIL", reason="Pillow is not installed")
    monkeypatch.chdir(packed)
    text = (packed / "README.md").read_text()
    (example,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    found, names = [], {}
    exec(example + "    found.append((told['frame'], rgb, depth_m, c2w))\n", names | {"found": found})
    rows = (dataset / "clean/attic/traj.txt").read_text().splitlines()
    assert len(found) == 6
    for (number, rgb, depth_m, c2w), wanted, row in zip(found, stored(dataset, "clean/attic"), rows, strict=True):
        assert number == wanted[0]
        np.testing.assert_array_equal(rgb, wanted[1])
        np.testing.assert_array_equal(depth_m, wanted[2])
        np.testing.assert_allclose(c2w, np.array(row.split(), float).reshape(4, 4), atol=1e-12)


def test_samples_of_all_sequences_have_keys_of_their_own(packed):
    wds = pytest.importorskip("webdataset", reason="webdataset is not installed")
    tars = sorted(map(str, packed.glob("*/*.tar")))
    samples = list(wds.WebDataset(tars, shardshuffle=False))
    assert len({sample["__key__"] for sample in samples}) == len(samples) == 38
    assert {tuple(sorted(name for name in sample if "__" not in name)) for sample in samples} == {
        ("depth.png", "json", "rgb.png")
    }


def test_datasets_streams_every_frame(dataset, packed):
    hub = pytest.importorskip("datasets", reason="datasets is not installed")
    pytest.importorskip("PIL", reason="Pillow is not installed")
    tars = sorted(map(str, packed.glob("*/*.tar")))
    stream = hub.load_dataset("webdataset", data_files={"train": tars}, split="train", streaming=True)
    found = {}
    for frame in stream:
        found.setdefault(f"{frame['json']['setting']}/{frame['json']['scene']}", []).append(frame)
    assert {name: len(frames) for name, frames in found.items()} == {
        f"{setting}/{scene}": count
        for setting, count in (("clean", 6), ("noise", 6), ("late", 4), ("fast.x2", 3))
        for scene in ("attic", "hall")
    }
    for frame, (number, rgb, depth_m) in zip(found["noise/hall"], stored(dataset, "noise/hall"), strict=True):
        assert frame["json"]["frame"] == number
        np.testing.assert_array_equal(np.asarray(frame["rgb.png"]), rgb)
        np.testing.assert_array_equal(np.asarray(frame["depth.png"]) / frame["json"]["depth_scale_per_m"], depth_m)
        assert [step["name"] for step in json.loads(frame["json"]["perturbed"])["rgb"]] == ["gaussian_noise"]


def test_croissant_is_valid_and_gives_the_frames(packed, caplog):
    croissant = pytest.importorskip("mlcroissant", reason="mlcroissant is not installed")
    described = croissant.Dataset(str(packed / "croissant.json"))
    assert not described.metadata.issues.errors
    assert "not standard" not in caplog.text  # the context is the specification's
    rows = list(described.records("frames"))
    assert len(rows) == 38
    assert rows[0]["frames/setting"] == b"clean"
    assert np.shape(rows[0]["frames/c2w"]) == (16,)


def test_a_tar_of_the_table_is_read_in_ranges(dataset, packed):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    table = pandas.read_parquet(packed / "manifest.parquet", filters=[("setting", "==", "late")])
    row = table[(table.scene == "hall") & (table.frame == 3)].iloc[0]
    with (packed / row.tar).open("rb") as tar:
        tar.seek(row.depth_offset)
        data = tar.read(row.depth_size)
    assert data == (dataset / "late/hall/results/depth000003.png").read_bytes()
