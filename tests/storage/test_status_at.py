# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world status` of datasets at an address: under way, finished, damaged; nothing is changed there."""

import shutil
import tarfile

from asked_status import as_json, status
from packed import put_shard

from noisy_world.dataset.store import open_store

FRAMES = {"clean": 6, "fast.x2": 3, "late": 4, "noise": 6}


def counts(found):
    return {name: (item["frames_done"], item["frames"]) for name, item in found["sequences"].items()}


def marks(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


def change(path, at):
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


def member(tar, name):
    with tarfile.open(tar) as opened:
        return opened.getmember(name).offset_data


def test_a_dataset_that_is_being_made(dataset, tmp_path, capsys):
    preset, folder, address = dataset.parent / "preset.json", tmp_path / "there", f"file://{tmp_path}/there"
    for name in ("hall.000000-000002", "hall.000002-000003", "hall.000001-000004"):  # they overlap
        put_shard(preset, address, tmp_path / "scratch", name)
    before = marks(folder)
    for place in (address, folder):
        code, found = as_json(capsys, place)
        assert (code, found["ended"], found["whole"], found["lost"], found["damaged"]) == (0, False, False, [], [])
        # Late shows depth two frames later, so of colours 0 to 3 and depths 0 to 3 two frames have both.
        there = {"clean/hall": 4, "noise/hall": 4, "late/hall": 2, "fast.x2/hall": 2}
        assert counts(found) == {
            f"{setting}/{scene}": (there.get(f"{setting}/{scene}", 0), count)
            for setting, count in FRAMES.items()
            for scene in ("attic", "hall")
        }
        assert found["shards"]["finished"] == ["hall.000000-000002", "hall.000001-000004", "hall.000002-000003"]
    code, said = status(capsys, address, "--check")
    assert code == 0
    assert "4 settings, 2 scenes, 8 sequences, 12 of 38 frames (31 %); its run has not come to its end\n" in said.out
    assert "shards   3 finished and to be merged\n" in said.out
    assert "about " in said.out
    assert marks(folder) == before
    shards = folder / ".noisy_world/shards"
    change(
        shards / "hall.000002-000003.tar",
        member(shards / "hall.000002-000003.tar", "noise/hall/results/frame000002.png"),
    )
    change(
        shards / "hall.000000-000002.tar",
        member(shards / "hall.000000-000002.tar", "noise/hall/results/frame000000.png"),
    )
    (shards / "hall.000001-000004.json").write_text("{")
    code, found = as_json(capsys, address, "--check")
    assert (code, found["damaged"]) == (1, ["noise/hall/results/frame000000.png", "noise/hall/results/frame000002.png"])
    assert counts(found)["noise/hall"] == (1, 6)
    (note,) = found["notes"]
    assert note.startswith(".noisy_world/shards/hall.000001-000004.json: cannot be used, or its tar is not whole")


def test_chosen_frames_of_a_run_that_is_made_of_some(dataset, tmp_path, capsys):
    address = f"memory://some/{tmp_path.name}"
    preset, scratch = dataset.parent / "preset.json", tmp_path / "scratch"
    put_shard(preset, address, scratch, "hall.000000-000002", frames=slice(0, 2))
    assert counts(as_json(capsys, address)[1])["clean/hall"] == (2, 2)
    assert counts(as_json(capsys, address, "--frames", "1:5")[1])["clean/hall"] == (1, 4)
    open_store(address).fs.rm(f"/some/{tmp_path.name}", recursive=True)


def test_a_finished_dataset_and_what_is_wrong_with_it(packed, tmp_path, capsys):
    folder = tmp_path / "noisy"
    shutil.copytree(packed, folder)
    before = marks(folder)
    for place in (folder, f"file://{folder}"):
        for words in ((), ("--check",)):
            code, found = as_json(capsys, place, *words)
            assert (code, found["ended"], found["whole"], found["frames_done"]) == (0, True, True, 38)
            assert counts(found)["late/hall"] == (4, 4)
        assert counts(as_json(capsys, place, "--frames", "2:5")[1])["late/hall"] == (2, 2)
    assert marks(folder) == before
    (folder / "clean/attic.tar").unlink()
    (folder / "clean/hall.tar").write_bytes((folder / "clean/hall.tar").read_bytes()[:4000])
    change(folder / "noise/hall.tar", member(folder / "noise/hall.tar", "noise/hall/frames/000003.rgb.png") + 20)
    change(folder / "noise/attic.tar", member(folder / "noise/attic.tar", "noise/attic/frames/000003.json") + 20)
    change(folder / "late/hall.tar", member(folder / "late/hall.tar", "late/hall/frames/texts/traj_txt"))
    (folder / "README.md").unlink()
    code, found = as_json(capsys, folder)
    assert (code, found["lost"], found["damaged"]) == (1, ["README.md", "clean/attic.tar"], ["clean/hall.tar"])
    assert counts(found)["clean/attic"] == counts(found)["clean/hall"] == (0, 6)
    code, found = as_json(capsys, folder, "--check")
    assert code == 1
    assert {"README.md", "clean/attic.tar", "clean/hall/frames.jsonl"} <= set(found["lost"])
    wanted = ["late/hall/traj.txt", "noise/attic.tar", "noise/hall/results/frame000003.png"]
    assert [name for name in found["damaged"] if not name.startswith("clean/hall")] == wanted
    assert (counts(found)["noise/hall"], counts(found)["noise/attic"]) == ((5, 6), (6, 6))
    code, said = status(capsys, folder, "--check")
    assert ["noise", "done", "!1", "5/6", "!1"] in [line.split() for line in said.out.splitlines()]


def test_where_nothing_is_or_what_is_not_ours(tmp_path, capsys):
    code, said = status(capsys, "memory://nothing")
    assert (code, said.err) == (
        1,
        "noisy-world status: memory://nothing: holds no dataset of Noisy World, nor one that was begun; "
        "name the folder that generate wrote\n",
    )
    (tmp_path / "manifest.json").write_text('{"other": 1}')
    code, said = status(capsys, f"file://{tmp_path}")
    assert code == 1
    assert "manifest.json is not the identity of a dataset\n" in said.err
    (tmp_path / "manifest.json").unlink()
    (tmp_path / ".noisy_world").mkdir()
    (tmp_path / ".noisy_world/identity.json").write_text("{")
    code, said = status(capsys, f"file://{tmp_path}")
    assert code == 1
    assert "identity.json: is not of this version of Noisy World" in said.err
