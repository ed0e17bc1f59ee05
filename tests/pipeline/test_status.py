# SPDX-License-Identifier: GPL-3.0-or-later
"""`noisy-world status`: counts against folders read by hand, in the middle of a run, after it, and of what is wrong."""

import sys
import threading

import fake_session
import pytest
from asked_status import as_json, status
from runs import run
from many_settings import COUNT, SETTINGS, make_shard
from worlds import write_world

from noisy_world.cli.status import cell, family_of
from noisy_world.dataset.stored import FileInventory, JournalTimes
from noisy_world.dataset.shards import shard_folder
from noisy_world.core.errors import InterruptedRunError
from noisy_world.dataset.shards import shards_of
from noisy_world.preset.keys import read_preset
from noisy_world.dataset.dataset_status import SequenceStatus, pace_of
from noisy_world.dataset.plan import make_plan

FRAMES = {"early": 7, "fast": 3, "mixed": 4}  # of 8: one is dropped at the edge; every third; every second


@pytest.fixture
def world(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    return write_world(tmp_path / "world", frames=COUNT, size=(16, 12), settings=SETTINGS)


def test_a_finished_dataset(world, tmp_path, capsys):
    out = tmp_path / "out"
    run(world, out)
    code, found = as_json(capsys, out, "--check")
    assert (code, found["whole"], found["ended"], found["checked"]) == (0, True, True, True)
    counts = {name: item["frames_done"] for name, item in found["sequences"].items()}
    by_hand = {name: len(list((out / name / "results").glob("frame*"))) for name in counts}
    assert counts == by_hand
    assert counts == {name: FRAMES.get(name.split("/")[0], COUNT) for name in by_hand}
    assert found["frames_done"] == found["frames"] == sum(by_hand.values())
    code, said = status(capsys, out)
    assert code == 0
    assert f"{len(counts)} settings, 1 scene, {len(counts)} sequences, 86 of 86 frames (100 %)\n" in said.out
    assert "time     the last run has come to its end; its last run took" in said.out


def test_a_run_that_fails_before_its_manifest_is_not_whole(world, tmp_path, capsys, monkeypatch):
    def failing(*_):
        raise RuntimeError("in the middle")

    monkeypatch.setattr("noisy_world.dataset.completion.manifest", failing)
    with pytest.raises(RuntimeError, match="in the middle"):
        run(world, tmp_path / "out")
    _, found = as_json(capsys, tmp_path / "out")
    assert (found["frames_done"], found["frames"], found["ended"], found["whole"]) == (86, 86, False, False)


def test_lost_and_damaged_files_are_named(world, tmp_path, capsys):
    out = tmp_path / "out"
    run(world, out)
    (out / "noise/box/results/frame000003.png").unlink()
    (out / "noise/box/traj.txt").write_text("0\n")
    image = out / "varied/box/results/frame000001.png"
    data = bytearray(image.read_bytes())
    data[-9] ^= 1
    image.write_bytes(data)
    code, found = as_json(capsys, out)  # without --check, what is lost is seen, and what is damaged is not
    assert (code, found["lost"], found["damaged"]) == (1, ["noise/box/results/frame000003.png"], [])
    code, found = as_json(capsys, out, "--check")
    assert (code, found["lost"]) == (1, ["noise/box/results/frame000003.png"])
    assert found["damaged"] == ["noise/box/traj.txt", "varied/box/results/frame000001.png"]
    assert found["sequences"]["noise/box"]["frames_done"] == found["sequences"]["varied/box"]["frames_done"] == 7
    code, said = status(capsys, out, "--check")
    assert ["noise", "7/8", "!1"] in [line.split() for line in said.out.splitlines()]
    assert "damaged  2 files: noise/box/traj.txt, varied/box/results/frame000001.png" in said.out


def test_a_run_that_was_stopped_and_one_that_grows(world, tmp_path, capsys, monkeypatch):
    out, stop = tmp_path / "out", threading.Event()
    make = fake_session.Session.frame

    def frame(self, request):
        if len(self.rendered) == 3:
            stop.set()
        return make(self, request)

    monkeypatch.setattr(fake_session.Session, "frame", frame)
    fake_session.Session.rendered.clear()
    with pytest.raises(InterruptedRunError):
        run(world, out, stop=stop)
    code, found = as_json(capsys, out, "--check")
    assert (code, found["ended"], found["whole"], found["frames"]) == (0, False, False, 86)
    by_hand = sum(len(list((out / name / "results").glob("depth*"))) for name in found["sequences"])
    assert 0 < found["frames_done"] <= by_hand < 86
    assert found["sequences"]["shaky/box"]["frames_done"] == 0  # a render of its own, which comes later
    code, said = status(capsys, out)
    assert "its run has not come to its end" in said.out
    assert "; the last frame was written " in said.out

    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    run(world, out, frames=slice(2, 5))
    _, found = as_json(capsys, out)  # the frames that were begun stay; none is missing of those that a run has ended
    assert (found["ended"], found["whole"]) == (True, True)
    _, found = as_json(capsys, out, "--frames", "2:5")
    assert found["frames"] == found["frames_done"] == 33
    _, found = as_json(capsys, out, "--frames", "5:")
    assert found["frames_done"] < found["frames"]


def test_a_perturbation_that_is_not_installed(world, tmp_path, capsys):
    out = tmp_path / "out"
    run(world, out)
    text = (out / "manifest.json").read_text()
    (out / "manifest.json").write_text(text.replace('"name": "desync"', '"name": "of_another_package"'))
    code, found = as_json(capsys, out)
    assert (code, found["frames"]) == (0, 86)  # what a run has ended says how many it made
    code, found = as_json(capsys, out, "--frames", "0:4")
    assert found["sequences"]["early/box"]["frames"] is None is found["frames"]
    assert found["sequences"]["clean/box"]["frames"] == 4


def begun(out, identity):
    (out / ".noisy_world").mkdir(parents=True)
    (out / ".noisy_world/identity.json").write_text(identity)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda out: None, "there is no such folder"),
        (lambda out: out.write_text(""), "is not a folder"),
        (lambda out: out.mkdir(), "holds no dataset of Noisy World, nor one that was begun"),
        (lambda out: (out / ".noisy_world").mkdir(parents=True), "holds no dataset of Noisy World, nor one that was"),
        (lambda out: begun(out, "{}"), ".noisy_world/identity.json is not the identity of a dataset, so what the"),
    ],
)
def test_what_holds_no_dataset_gets_one_line(tmp_path, capsys, make, words):
    make(tmp_path / "out")
    code, said = status(capsys, tmp_path / "out")
    assert (code, said.out) == (1, "")
    assert said.err.startswith(f"noisy-world status: {tmp_path / 'out'}: {words}")
    assert said.err.count("\n") == 1


def test_reading_changes_nothing(world, tmp_path, capsys):
    out = tmp_path / "out"
    run(world, out)
    before = {path: path.stat().st_mtime_ns for path in [out, *out.rglob("*")]}
    status(capsys, out, "--check")
    assert {path: path.stat().st_mtime_ns for path in [out, *out.rglob("*")]} == before


def test_the_time_left_weighs_what_frames_cost():
    # One sequence at 2 frames a second, of 0.5 s each by the estimate: the run goes at the estimate's speed. What is
    # left: 10 of them, and 10 frames of 4 s in another: 45 s.
    written = [("a/box", JournalTimes(tuple(1000 + k / 2 for k in range(9)), 1.0, cut=False))]
    pace = pace_of(written, {"a/box": 0.5, "b/box": 4.0}, {"a/box": 10, "b/box": 10}, now_s=1005.0)
    assert (pace.last_s, pace.window_s, pace.frames_per_s, pace.left_s) == (1.0, 4.0, 2.0, 45.0)
    assert not pace.silent
    assert pace_of(written, {"a/box": 0.5}, {"a/box": 10}, now_s=1100.0).silent
    assert pace_of(written, {"a/box": 0.5}, None, now_s=1005.0).left_s is None
    assert pace_of(written[:0], {}, {}, now_s=1005.0).last_s is None
    one = [("a/box", JournalTimes((1000.0,), 1.0, cut=False))]
    assert pace_of(one, {"a/box": 0.5}, {"a/box": 10}, now_s=1005.0).frames_per_s is None


def test_journals_that_were_read_in_part_count_from_where_they_begin():
    # Two writers of 1 and 100 frames a second; of the quick one only the last second was read.
    slow = JournalTimes(tuple(float(k) for k in range(101)), 1.0, cut=False)
    quick = JournalTimes(tuple(99 + k / 100 for k in range(101)), 1.0, cut=True)
    pace = pace_of(
        [("a/box", slow), ("b/box", quick)], {"a/box": 1.0, "b/box": 1.0}, {"a/box": 0, "b/box": 202}, now_s=100.0
    )
    assert pace.frames_per_s == pytest.approx(101)
    assert pace.left_s == pytest.approx(2)


def test_severities_share_a_row_in_a_long_table():
    assert {family_of(name) for name in ("fog_s1", "fog_s3_dynamic", "fog_s4.5", "fog")} == {"fog"}
    assert family_of("fog_static") == "fog_static"
    items = [
        SequenceStatus("fog_s1", "a", 10, FileInventory(10)),
        SequenceStatus("fog_s2", "a", 10, FileInventory(4, ("x",))),
    ]
    nothing = [SequenceStatus("f", "a", 10, FileInventory(0))]
    assert [cell(items[:1]), cell(items), cell([]), cell(nothing)] == [
        "done", "14/20 !1", "", "-",
    ]  # fmt: skip
    assert cell([SequenceStatus("f", "a", None, FileInventory(3))]) == "3/?"


def test_a_dataset_made_in_shards(world, tmp_path, capsys):
    out = tmp_path / "out"
    plan = make_plan(read_preset(world))
    names = [shard for shard in shards_of(plan, 4) if shard.render == "box"]
    for shard in names[:2]:
        make_shard(plan, shard_folder(out, shard), shard)
    _, found = as_json(capsys, out, "--check")
    finished = found["shards"]["finished"]
    assert finished == [shard.name for shard in names[:2]]
    assert "only the shards that were begun are known" in found["notes"][0]
    by_hand = sum(len(list(out.rglob(f".noisy_world/shards/*/{name}/results/frame*"))) for name in found["sequences"])
    done = sum(item["frames_done"] for item in found["sequences"].values())
    assert 0 < done <= by_hand  # under desynchronisation, colour and depth of a frame may be in different shards
    assert found["sequences"]["noise/box"] == {"frames_done": names[1].stop, "frames": COUNT}
    _, said = status(capsys, out)
    assert "shards   2 finished and to be merged\n" in said.out

    image = next(out.rglob("noise/box/results/frame000000.png"))
    image.unlink()  # another setting's image may be the same file
    image.write_bytes(b"")
    code, found = as_json(capsys, out, "--check")
    assert (code, found["damaged"]) == (1, ["noise/box/results/frame000000.png"])
    image.unlink()
    (image.parents[3] / "shard.json").rename(tmp_path / "record")
    (image.parents[3] / ".noisy_world").mkdir()
    _, found = as_json(capsys, out)  # a shard that was begun, and of which nothing is recorded
    assert list(found["shards"]["unfinished"]) == [names[0].name]
    (tmp_path / "record").rename(image.parents[3] / "shard.json")
    run(world, out)
    code, found = as_json(capsys, out, "--check")
    assert (code, found["whole"], found["shards"]) == (0, True, {"merged": [], "finished": [], "unfinished": {}})


def test_a_manifest_that_somebody_changed_is_damaged(world, tmp_path, capsys):
    out = tmp_path / "out"
    run(world, out)
    manifest = out / "manifest.json"
    text = manifest.read_text()
    for old, new in (('"seed": 3', '"seed": 4'), ("sRGB-encoded", "linear"), ("\n}\n", "\n}\n\n")):
        assert old in text
        manifest.write_text(text.replace(old, new, 1))
        code, found = as_json(capsys, out, "--check")
        assert (code, found["whole"], found["damaged"]) == (1, False, ["manifest.json"])
    # What still says the same is written again by the next run, which says so.
    assert "manifest.json is not as it was written; it is written again" in run(world, out).notes
    assert manifest.read_text() == text
    (out / "run.json").write_text("{}")
    code, found = as_json(capsys, out, "--check")
    assert (code, found["notes"]) == (0, ["run.json does not tell the SHA-256 of manifest.json, which is not checked"])
