# SPDX-License-Identifier: GPL-3.0-or-later
"""Packed datasets opened, written as recipes and verified, against the folder that they were packed from."""

import io
import json
import multiprocessing
import pickle
import shutil
import sys
import tarfile
import threading
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from forked import in_new_process
from packed import pack_to, write_preset
from refusals import refused

import noisy_world
from noisy_world.cli import command
from noisy_world.core.errors import InputError, MissingDependencyError, StorageError
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.recipe import recipe_of
from noisy_world.dataset.recipe import read_recipe
from noisy_world.dataset.remaking import verify


@pytest.fixture
def copy(packed, tmp_path):
    shutil.copytree(packed, tmp_path / "noisy")
    return tmp_path / "noisy"


@pytest.fixture(scope="module")
def recipe(dataset, tmp_path_factory):
    path = tmp_path_factory.mktemp("recipe") / "noisy.recipe.json"
    path.write_text(recipe_of(dataset, PlainProgress(sys.stderr)).text())
    return path


def found(recipe, place):
    findings = verify(read_recipe(recipe), place, PlainProgress(sys.stderr), threading.Event())
    return findings.lines()


def assert_same(frame, other):
    assert (frame.rgb_bytes(), frame.depth_bytes()) == (other.rgb_bytes(), other.depth_bytes())
    assert (frame.sequence, frame.index, frame.done) == (other.sequence, other.index, other.done)
    assert (frame.stamp_s, frame.depth_stamp_s) == (other.stamp_s, other.depth_stamp_s)
    for name in ("rgb", "rgb_uncompressed", "depth_m", "c2w"):
        one, two = getattr(frame, name), getattr(other, name)
        assert one.dtype == two.dtype
        assert np.array_equal(one, two), name


@pytest.mark.parametrize("way", ["folder", "address"])
def test_frames_are_the_folder_s_in_any_order(dataset, packed, way):
    files = noisy_world.open(dataset)
    opened = noisy_world.open(packed if way == "folder" else f"file://{packed}")
    assert list(opened) == list(files)
    assert len(opened["late/hall"]) == 4
    for name in reversed(list(files)):
        assert opened[name].camera == files[name].camera
        assert opened[name].frames == files[name].frames
        for number in reversed(files[name].frames):
            assert_same(opened[name][number], files[name][number])
    kept = pickle.loads(pickle.dumps(opened["noise/hall"][3]))
    assert_same(kept, files["noise/hall"][3])
    refused(lambda: opened["late/hall"][4], names=("late/hall", "frame 4", "0 to 3"), error=IndexError)


def test_a_packed_part_has_its_own_numbers(tmp_path):
    from runs import run

    run(write_preset(tmp_path), tmp_path / "out", frames=slice(2, 5))
    pack_to(tmp_path / "out", f"file://{tmp_path}/packed")
    files, opened = noisy_world.open(tmp_path / "out"), noisy_world.open(tmp_path / "packed")
    assert [*opened["clean/hall"].frames] == [2, 3, 4]
    listed = opened.frames("clean", frames=slice(3, None))
    assert [listed.where(place) for place in range(len(listed))] == [
        (f"clean/{scene}", number) for scene in ("attic", "hall") for number in (3, 4)
    ]
    assert_same(opened["clean/hall"][4], files["clean/hall"][4])


LISTED = []
PLACES = [7, 0, 19]


def load(pickled):
    LISTED.append(pickle.loads(pickled))


def fetch(place):
    return {name: value for name, value in LISTED[-1][place].items() if name in ("rgb", "depth_m", "sequence", "index")}


def frames_at(address):
    opened = noisy_world.open(address)
    assert len(opened["noise/hall"][2].rgb_bytes()) > 0  # connections are open
    return opened.frames(["late", "noise"])


def fetched_by_forks(address):
    LISTED.append(frames_at(address))
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
        return list(pool.map(fetch, PLACES))


def fetched_by_spawned(address):
    options = {"initializer": load, "initargs": (pickle.dumps(frames_at(address)),)}
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), **options) as pool:
        return list(pool.map(fetch, PLACES))


@pytest.mark.parametrize("forked", [True, False])
def test_workers_read_from_a_store(store, dataset, forked):
    """As DataLoader's workers do: the dataset comes pickled, or lies in the memory of the process that was forked."""
    address = store.bucket(f"opened-{forked}".lower())
    pack_to(dataset, address)
    samples = in_new_process(fetched_by_forks, address) if forked else fetched_by_spawned(address)
    listed = noisy_world.open(address).frames(["late", "noise"])
    for place, sample in zip(PLACES, samples, strict=True):
        name, number = listed.where(place)
        frame = noisy_world.open(dataset)[name][number]
        assert (sample["sequence"], sample["index"]) == (name, number)
        assert np.array_equal(sample["rgb"], frame.rgb)
        assert np.array_equal(sample["depth_m"], frame.depth_m)


@pytest.mark.parametrize(
    ("layout", "modalities"), [("tum", ["rgb", "depth"]), ("euroc", ["rgb", "depth"]), ("euroc", ["depth"])]
)
def test_recipes_and_frames_of_other_layouts(layout, modalities, tmp_path, monkeypatch):
    import fake_session
    from runs import run
    from written import world

    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", fake_session)
    run(
        world(tmp_path / "world", layout, output={"modalities": modalities}, settings=[{"name": "clean"}]),
        tmp_path / "out",
    )
    pack_to(tmp_path / "out", f"file://{tmp_path}/packed")
    progress = PlainProgress(sys.stderr)
    text = recipe_of(tmp_path / "out", progress).text()
    assert recipe_of(tmp_path / "packed", progress).text() == text
    (tmp_path / "recipe.json").write_text(text)
    assert found(tmp_path / "recipe.json", tmp_path / "packed") == []
    frame = noisy_world.open(tmp_path / "packed")["clean/box"][1]
    depth = sorted(path for path in (tmp_path / "out/clean/box").rglob("*depth*/*.png")) or sorted(
        path for path in (tmp_path / "out/clean/box").rglob("*.png")
    )
    assert frame.depth_bytes() in [path.read_bytes() for path in depth]
    if modalities == ["depth"]:
        refused(lambda: frame.rgb, names="no colour")


def test_the_recipe_is_the_folder_s(recipe, packed, tmp_path, capfd):
    for place in (packed, f"file://{packed}"):
        assert command.main(["recipe", str(place), "--out", str(tmp_path / "recipe.json")]) == 0
        assert (tmp_path / "recipe.json").read_bytes() == recipe.read_bytes()


def test_what_is_whole_is_verified(recipe, packed, capfd):
    for place in (packed, f"file://{packed}"):
        assert command.main(["verify", str(recipe), str(place)]) == 0
        assert capfd.readouterr().out == "8 sequences, 76 images as the recipe says\n"


def changed(path, at):
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


def test_every_kind_of_damage_is_named(recipe, copy):
    with tarfile.open(copy / "noise/hall.tar") as tar:
        image = tar.getmember("noise/hall/frames/000003.rgb.png").offset_data
    changed(copy / "noise/hall.tar", image + 60)
    changed(copy / "clean/attic.tar", 540)  # inside the first image
    changed(copy / "late/hall.tar", 300)  # in a header, of what nobody looks at: its checksum
    (copy / "late/attic.tar").unlink()
    (copy / "clean/more.txt").touch()
    changed(copy / "manifest.parquet", 1000)
    (copy / "README.md").unlink()
    lines = found(recipe, copy)
    damaged = "damaged (not as it was written)"
    assert f"noise/hall: results/frame000003.png: {damaged}" in lines
    assert f"clean/attic: results/frame000000.png: {damaged}" in lines
    assert "late/attic: missing" in lines
    assert any(line.startswith("late/hall: ") and line.endswith(": missing") for line in lines)  # nothing can be read
    assert f".: manifest.parquet: {damaged}" in lines
    assert ".: late/cam_params.json, README.md: missing" in lines  # both tars that hold the first are unreadable
    assert ".: clean/more.txt: extra (neither the recipe nor the dataset's records name it)" in lines
    refused(noisy_world.open(copy)["noise/hall"][3].rgb_bytes, names="noise/hall.tar: results/frame000003.png: ")
    assert noisy_world.open(copy)["noise/hall"][3].depth_m.any()
    refused(recipe_of, copy, PlainProgress(sys.stderr), names="manifest.parquet: ")
    with tarfile.open(copy / "fast.x2/hall.tar") as tar:
        changed(copy / "fast.x2/hall.tar", tar.getmember("fast.x2/hall/frames/000001.json").offset_data + 5)
    assert f".: fast.x2/hall.tar, manifest.parquet: {damaged}" in found(recipe, copy)  # no file of the layout


def with_header(path, member, at, value):
    """Change a member's header in a tar and its checksum with it, which POSIX has at 148: the sum with blanks there."""
    with tarfile.open(path) as tar:
        start = tar.getmember(member).offset
    data = bytearray(path.read_bytes())
    header = data[start : start + 512]
    header[at : at + len(value)] = value
    header[148:156] = b" " * 8
    header[148:156] = b"%06o\0 " % sum(header)
    data[start : start + 512] = header
    path.write_bytes(data)


IMAGE, LINK = "noise/hall/frames/000003.rgb.png", "noise/hall/results/frame000003.png"


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ((IMAGE, 136, b"00000000001"), ".: noise/hall.tar: damaged (not as it was written)"),  # its time
        ((IMAGE, 124, b"not a size!"), "noise/hall: 6 frames that frames.jsonl should name, frames.jsonl, traj.txt: m"),
        ((IMAGE, 0, b"noise/hall/frames/000009"), "noise/hall: results/frame000003.png: missing"),
        ((LINK, 157, b"noise/hall/frames/000009"), "noise/hall: results/frame000003.png: missing"),  # leads nowhere
        ((LINK, 157, b"noise/hall/frames/000002"), "noise/hall: results/frame000003.png: damaged (not as it was"),
    ],
)
def test_headers_that_say_something_else_are_damage(recipe, copy, change, told):
    with_header(copy / "noise/hall.tar", *change)
    lines = found(recipe, copy)
    assert any(line.startswith(told) for line in lines), lines
    assert all(line.startswith((".: ", "noise/hall: ")) for line in lines), lines  # the others are whole
    assert command.main(["status", str(copy), "--check"]) == 1


def test_an_extended_header_without_a_number_is_damage(recipe, copy):
    # Python's tarfile raises ValueError at these, which is none of its own errors.
    path = copy / "noise/hall.tar"
    old = path.read_bytes()
    with tarfile.open(path) as tar, io.BytesIO() as whole:
        start = tar.getmember(IMAGE).offset
        with tarfile.open(fileobj=whole, mode="w", format=tarfile.PAX_FORMAT) as head:
            item = tarfile.TarInfo(IMAGE)
            item.pax_headers = {"GNU.sparse.map": "no,number", "GNU.sparse.size": "1"}
            head.addfile(item)
        path.write_bytes(old[:start] + whole.getvalue() + old[start:])
    assert any(line.startswith("noise/hall: ") and line.endswith(": missing") for line in found(recipe, copy))
    assert command.main(["status", str(copy), "--check"]) == 1


@pytest.mark.parametrize("left", [0, 100, 5000])
def test_a_tar_that_is_cut_off(recipe, copy, left):
    tar = copy / "noise/hall.tar"
    tar.write_bytes(tar.read_bytes()[:left])
    lines = found(recipe, copy)
    assert any(line.startswith("noise/hall: ") and "missing" in line for line in lines)
    refused(
        lambda: noisy_world.open(copy)["noise/hall"][5].rgb_bytes(),  # noqa: PLW0108 - opening may refuse it
        names="noise/hall.tar",
        error=(InputError, StorageError),
    )


def test_a_damaged_table_is_one_line(copy):
    table = copy / "manifest.parquet"
    for torn in (table.read_bytes()[:-20], b"PAR1" + bytes(100) + b"PAR1", None):
        table.unlink() if torn is None else table.write_bytes(torn)
        refused(noisy_world.open, f"file://{copy}", names="manifest.parquet: is ")


def test_what_is_not_there_or_not_finished(recipe, copy, packed, monkeypatch):
    refused(noisy_world.open, "memory://nothing", names=("memory://nothing: ", "no dataset"))
    refused(noisy_world.open, "memory://nothing", "clean", names="clean goes with a recipe")
    manifest = json.loads((copy / "manifest.json").read_text())
    (copy / "manifest.json").unlink()
    work = copy / ".noisy_world"
    work.mkdir(exist_ok=True)
    (work / "identity.json").write_text(json.dumps({"identity": manifest["identity"], "chosen": None}))
    for ask in (
        noisy_world.open,
        lambda place: recipe_of(place, PlainProgress(sys.stderr)),
        lambda p: found(recipe, p),
    ):
        refused(ask, copy, names=(str(copy), "run the same command again"))
    (copy / "manifest.json").write_text("{}")
    refused(noisy_world.open, copy, names="manifest.json is not")
    for package, place in (("fsspec", "memory://nothing"), ("pyarrow", packed)):  # a folder needs no fsspec
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, package, None)
            refused(noisy_world.open, place, names=(f"needs {package}", "[cloud]"), error=MissingDependencyError)
