# SPDX-License-Identifier: GPL-3.0-or-later
"""What lies in a packed dataset, read by others: GNU tar, tarfile, pyarrow, pandas."""

import hashlib
import json
import subprocess
import sys
import tarfile

import cv2
import fake_session
import numpy as np
import pyarrow.parquet
import pytest
from runs import run
from packed import pack_to
from worlds import content, path_poses
from written import world

LISTED = ["fast.x2", "clean", "late", "noise"]


def test_unpacked_tars_are_the_dataset(dataset, packed, tmp_path):
    for tar in sorted(packed.glob("*/*.tar")):
        subprocess.run(["tar", "-xf", tar, "-C", tmp_path], check=True)
    for frames in tmp_path.glob("*/*/frames"):
        subprocess.run(["rm", "-r", frames], check=True)
    (tmp_path / "manifest.json").write_bytes((packed / "manifest.json").read_bytes())
    (tmp_path / "run.json").touch()
    assert content(tmp_path) == content(dataset)


def test_tars_and_table_are_the_same_wherever_they_are_written(dataset, packed, tmp_path):
    pack_to(dataset, f"file://{tmp_path}/noisy")
    names = sorted(str(path.relative_to(packed)) for path in packed.rglob("*") if path.is_file())
    assert len(names) == 8 + 5
    for name in names:
        assert (tmp_path / "noisy" / name).read_bytes() == (packed / name).read_bytes(), name


def test_what_is_left_of_a_pack_that_failed_is_mended_and_has_no_manifest(dataset, packed, tmp_path, monkeypatch):
    def failing(*_):
        raise RuntimeError("in the middle")

    place = tmp_path / "noisy"
    with monkeypatch.context() as patched:
        patched.setattr("noisy_world.dataset.packing.croissant", failing)
        with pytest.raises(RuntimeError, match="in the middle"):
            pack_to(dataset, f"file://{place}")
    assert not (place / "manifest.json").exists()
    (place / "noise/hall.tar").write_bytes((packed / "noise/hall.tar").read_bytes()[:-512])
    (place / "clean/hall.tar").unlink()
    whole = place / "late/hall.tar"
    before = whole.stat().st_mtime_ns
    pack_to(dataset, f"file://{place}")
    assert whole.stat().st_mtime_ns == before, "what is whole is not written again"
    for path in packed.rglob("*.tar"):
        assert (place / path.relative_to(packed)).read_bytes() == path.read_bytes()


def test_tars_end_with_a_whole_record(packed):
    # POSIX.1-2017, pax: by default a record of ustar has 20 blocks of 512 bytes.
    assert {path.stat().st_size % 10240 for path in packed.rglob("*.tar")} == {0}


def test_headers_say_nothing_of_who_wrote_them(packed):
    with tarfile.open(packed / "noise/hall.tar") as tar:
        for member in tar:
            assert (member.uid, member.gid, member.uname, member.gname, member.mtime) == (0, 0, "", "", 0)
            assert member.mode == 0o644


def test_each_row_leads_to_its_bytes_and_pose(dataset, packed):
    table = pyarrow.parquet.read_table(packed / "manifest.parquet")
    rows = table.to_pylist()
    assert sorted({row["setting"] for row in rows}) == sorted(LISTED)
    assert len(rows) == 2 * (6 + 6 + 4 + 3)
    assert table.schema.metadata[b"pyarrow"].decode() == pyarrow.__version__
    poses = path_poses(6)
    for row in rows:
        sequence = dataset / row["setting"] / row["scene"]
        tar = (packed / row["tar"]).read_bytes()
        for kind in ("rgb", "depth"):
            data = tar[row[f"{kind}_offset"] :][: row[f"{kind}_size"]]
            assert data == (sequence / row[f"{kind}_file"]).read_bytes()
            assert hashlib.sha256(data).hexdigest() == row[f"{kind}_sha256"]
        told = json.loads(tar[row["json_offset"] :][: row["json_size"]])
        assert told["c2w"] == np.reshape(row["c2w"], (4, 4)).tolist()
        line = json.loads((sequence / "frames.jsonl").read_text().splitlines()[told["frame"]])
        assert line["time_s"] == row["time_s"] == told["time_s"]
        assert line.get("perturbed", {}) == json.loads(row["perturbed"])
        step = 2 if row["setting"] == "fast.x2" else 1
        np.testing.assert_allclose(np.reshape(row["c2w"], (4, 4)), poses[row["frame"] * step], atol=3e-9)
    late = [row for row in rows if row["setting"] == "late" and row["scene"] == "hall"]
    assert json.loads(late[0]["perturbed"])["pairing"] == {"depth_of_frame": 2}
    assert [row["depth_time_s"] for row in late] == [row["time_s"] for row in late]


def test_names_of_more_than_a_hundred_bytes(tmp_path):
    from noisy_world.dataset.tar_files import TarStream

    name = "very_long_setting." * 8 + "/scene/frames/000000.rgb.png"
    with (tmp_path / "a.tar").open("wb") as file:
        tar = TarStream(file)
        offset = tar.add(name, b"content")
        tar.link(name.replace("frames", "results"), name)
        tar.close()
    assert (tmp_path / "a.tar").read_bytes()[offset:][:7] == b"content"
    (tmp_path / "out").mkdir()
    subprocess.run(["tar", "-xf", tmp_path / "a.tar", "-C", tmp_path / "out"], check=True)
    assert (tmp_path / "out" / name.replace("frames", "results")).read_bytes() == b"content"


@pytest.mark.parametrize(
    ("layout", "modalities"), [("tum", ["rgb", "depth"]), ("euroc", ["rgb", "depth"]), ("euroc", ["depth"])]
)
def test_other_layouts(layout, modalities, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    settings = [{"name": "clean"}, {"name": "fast", "perturb": [{"faster_motion": {"factor": 2}}]}]
    preset = world(tmp_path / "world", layout, output={"modalities": modalities}, settings=settings)
    run(preset, tmp_path / "out")
    packed = tmp_path / "packed"
    pack_to(tmp_path / "out", f"file://{packed}")
    rows = pyarrow.parquet.read_table(packed / "manifest.parquet").to_pylist()
    assert [(row["setting"], row["frame"]) for row in rows] == [("clean", k) for k in range(4)] + [
        ("fast", 0),
        ("fast", 1),
    ]
    for row in rows:
        pose = path_poses(4)[row["frame"] * (2 if row["setting"] == "fast" else 1)]
        np.testing.assert_allclose(np.reshape(row["c2w"], (4, 4)), pose, atol=1e-7)
        for kind in modalities:
            stored = (packed / row["tar"]).read_bytes()[row[f"{kind}_offset"] :][: row[f"{kind}_size"]]
            image = cv2.imdecode(np.frombuffer(stored, np.uint8), cv2.IMREAD_UNCHANGED)
            assert image.dtype == (np.uint16 if kind == "depth" else np.uint8)
    subprocess.run(["tar", "-xf", packed / "fast/box.tar", "-C", tmp_path], check=True)
    for path in (tmp_path / "out/fast/box").rglob("*"):
        if path.is_file():
            assert (tmp_path / path.relative_to(tmp_path / "out")).read_bytes() == path.read_bytes()
