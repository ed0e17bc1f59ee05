# SPDX-License-Identifier: GPL-3.0-or-later
"""What cannot be added to a dataset is refused in words of the preset, and nothing is touched."""

import json
import shutil
import sys
from types import SimpleNamespace

import fake_session
import pytest
from refusals import refused
from cases import cases
from growing import CLEAN, FOG, PATH, change, marks, world
from worlds import write_world
from runs import run

from noisy_world.dataset.folder_state import merged_identity
from noisy_world.core.errors import StorageError
from noisy_world.dataset.estimate import size_text

pytestmark = pytest.mark.usefixtures("no_blender")

REMEDY = "choose another folder with --out, or replace the dataset with --overwrite"
FOG_STEP = "settings.1.perturb.0.fog"


@cases(
    "values, words",
    [
        ({f"{FOG_STEP}.severity": 4}, "settings: fog (severity) was 3, is 4; give it another name, "),
        ({f"{FOG_STEP}.mode": "dynamic"}, "settings: fog (mode) was static, is dynamic; give it another name, "),
        ({f"{FOG_STEP}.uniform": True}, "settings: fog (uniform) was false, is true; give it another name, "),
        ({"settings.1.perturb": [{"contrast": None}]}, "settings: fog was fog, is contrast; give it another name, "),
        ({"settings.1.perturb": []}, "settings: fog was fog, is clean; give it another name, "),
        ({"settings.1.backend": "compositor"}, "settings: fog (backend) was reference, is compositor; give it another"),
        ({"settings.1.stream": "mist"}, "settings: fog (stream) was its own name, is mist; give it another name, "),
        ({"settings.2.perturb.0.desync.offset": 2}, "settings: late (offset) was 1, is 2; give it another name, "),
        ({"render.compositor_device": "gpu"}, f"render.compositor_device was null, is gpu; {REMEDY}"),
        ({"seed": 4}, f"seed was 3, is 4; {REMEDY}"),
        ({"camera.fx": 9.0}, f"camera.fx was 8, is 9; {REMEDY}"),
        ({"camera.width": 17}, f"camera.width was 16, is 17; {REMEDY}"),
        ({"camera.far_m": 9.5}, f"camera.far_m was 1000, is 9.5; {REMEDY}"),
        ({"render.samples": 2}, f"render.samples was 1, is 2; {REMEDY}"),
        ({"output.image": "jpg"}, f"output.image was png, is jpg; {REMEDY}"),
        ({"output.layout": "tum"}, f"output.layout was replica, is tum; {REMEDY}"),
        ({f"{PATH}.stop": 3}, f"{PATH}.stop was 6, is 3; keep the path, and choose its first frames with --frames 0:3"),
        ({f"{PATH}.every": 2}, f"{PATH}.every was 1, is 2, which makes another path; give it another name, "),
        ({f"{PATH}.start": 1}, f"{PATH}.start was 0, is 1, which makes another path; give it another name, "),
        ({f"{PATH}.rate_hz": 10}, f"{PATH}.rate_hz was 20, is 10, which makes another path; give it another name, "),
        ({"scenes.0.mesh": "embedded:room"}, "scenes.0.mesh was mesh.ply, is embedded:room; give it another name, "),
    ],
)
def test_what_differs_is_refused_in_words_of_the_preset(made, values, words):
    preset, out, before = made
    kept = preset.read_text()
    try:
        change(preset, values)
        said = refused(run, preset, out, names=[f"{out}: ", words], error=StorageError)
    finally:
        preset.write_text(kept)
    assert said.endswith(REMEDY)
    assert marks(out) == before


@cases(
    "name, old, new, names",
    [
        ("mesh.ply", "200 60 50", "201 60 50", ["scenes.0.mesh: mesh.ply"]),
        ("traj.txt", "1.2", "1.3", ["scenes.0.trajectory: traj.txt", "poses"]),
    ],
)
def test_a_file_that_changed_is_named(made, name, old, new, names):
    preset, out, before = made
    path = preset.with_name(name)
    kept = path.read_text()
    try:
        path.write_text(kept.replace(old, new, 1))
        refused(run, preset, out, names=[f"{out}: ", *names, REMEDY], error=StorageError)
    finally:
        path.write_text(kept)
    assert marks(out) == before


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A preset, its dataset, and the marks of its files."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
        folder = tmp_path_factory.mktemp("made")
        preset = world(folder / "world")
        run(preset, folder / "out")
        return preset, folder / "out", marks(folder / "out")


@cases(
    "part, key, words",
    [
        (("settings", "fog", "steps", 0), "version", "settings: fog (version) was 1, is 2"),
        (("versions",), "deflate", "PNG"),
    ],
)
def test_what_an_earlier_version_made_otherwise_stays_as_it_is(made, tmp_path, part, key, words):
    preset, out, _ = made
    there = tmp_path / key
    shutil.copytree(out, there)
    manifest = json.loads((there / "manifest.json").read_text())
    changed = manifest["identity"]
    for name in part:
        changed = changed[name]
    del changed[key]
    (there / "manifest.json").write_text(json.dumps(manifest))
    before = marks(there)
    said = refused(run, preset, there, names=[f"{there}: ", words, REMEDY], error=StorageError)
    assert said.count(REMEDY) == 1
    assert marks(there) == before


def test_a_dataset_of_jpegs_from_before_they_had_tables_of_their_own_stays_as_it_is(tmp_path):
    preset, out = world(tmp_path / "world"), tmp_path / "out"
    change(preset, {"output.image": "jpg"})
    run(preset, out)
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["identity"]["output"].pop("huffman") == "perturbed noise"
    (out / "manifest.json").write_text(json.dumps(manifest))
    before = marks(out)
    refused(run, preset, out, names=[f"{out}: ", "JPEG", REMEDY], error=StorageError)
    assert marks(out) == before


def test_a_dataset_of_another_version_is_refused_and_replaced(tmp_path):
    preset, out = world(tmp_path / "world"), tmp_path / "out"
    run(preset, out)
    manifest = json.loads((out / "manifest.json").read_text())
    # As the version before wrote it: a list of sequences, and the preset's document instead of scenes and settings.
    identity = {"format": 1, "preset": {}, "sequences": ["clean/box", "fog/box", "late/box"]}
    (out / "manifest.json").write_text(json.dumps({**manifest, "identity": identity}))
    refused(run, preset, out, names=[str(out), "earlier version"], error=StorageError)
    run(change(preset, {"settings": [CLEAN]}), out, overwrite=True)
    assert {path.name for path in out.iterdir()} == {"clean", "manifest.json", "run.json"}


@pytest.mark.parametrize("free", [0, 700])
def test_a_full_disk_is_said_before_anything_is_made(tmp_path, monkeypatch, free):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=free))
    # A frame of 80 x 60 pixels is about 1.5 + 0.5 bytes a pixel, twice in each of six frames but for linked depth.
    preset = write_world(tmp_path / "world", frames=6, size=(80, 60), settings=[CLEAN, FOG])
    told = f"about {6 * 4800 * (2 * 1.5 + 0.5) / 1e3:.0f} kB are to be written and {free} bytes are free"
    refused(run, preset, tmp_path / "out", names=[f"{tmp_path / 'out'}: ", told, "make room"], error=StorageError)
    assert not (tmp_path / "out").exists()


def test_a_disk_that_is_too_small_is_noted(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=20_000))
    preset = write_world(tmp_path / "world", frames=6, size=(80, 60), settings=[CLEAN, FOG])
    report = run(preset, tmp_path / "out")
    assert f"about 101 kB are to be written and 20 kB are free in {tmp_path / 'out'}" in report.notes[0]
    # One more setting of colour: its six images alone, as depth is linked.
    change(preset, {"settings": [CLEAN, FOG, {"name": "dim", "perturb": [{"brightness": None}]}]})
    report = run(preset, tmp_path / "out")
    assert "about 43 kB" in report.notes[0]


@pytest.mark.parametrize(
    ("count", "text"),
    [(0, "0 bytes"), (999, "999 bytes"), (1500, "1.5 kB"), (34_500_000, "34 MB"), (4_250_000_000, "4.2 GB")],
)
def test_sizes_in_words(count, text):
    assert size_text(count) == text


def test_what_only_kept_sequences_decide_stays_in_the_identity():
    # Of a rendered scene, to which a recording is added: the next run that renders is held against it.
    decided = {"near_m": 0.1, "far_m": 10.0, "rig": {"depth": {}}, "render": {"engine": "embree"}}
    there = {**decided, "scenes": {"box": {}}, "settings": {"clean": {}}, "sequences": {"clean/box": 3}, "versions": {}}
    here = {**dict.fromkeys(decided), "scenes": {"lab": {"path": {}}}, "settings": {"clean": {}}, "versions": {}}
    here["sequences"] = {"clean/lab": 2}
    merged = merged_identity(there, here, ["clean/box"])
    assert {key: merged[key] for key in decided} == decided
    assert (merged["scenes"].keys(), merged["sequences"]) == ({"box", "lab"}, {"clean/box": 3, "clean/lab": 2})
    assert merged_identity(there, here, []) == here
