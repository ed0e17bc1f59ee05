# SPDX-License-Identifier: GPL-3.0-or-later
"""Datasets in each layout: the keys that decide their files; written, read and written again; and removed."""

import hashlib
import json
import re
import sys
from itertools import pairwise

import numpy as np
import pytest
from refusals import refused
from worlds import content
from runs import run
from written import RIG, SHAKY, fake_depth_m, names_in, read, states, stored, world, write_tum_path

from noisy_world.layouts import LAYOUTS, find_sequence


pytestmark = pytest.mark.usefixtures("no_blender")


# --- the keys ---


@pytest.mark.parametrize("image", ["jpg", "png"])
def test_grey_where_a_preset_asks_for_it(tmp_path, image):
    settings = [{"name": "clean"}, {"name": "bright", "perturb": [{"brightness": {"severity": 2}}]}]
    preset = world(tmp_path / "w", "replica", output={"image": image, "colour": "grey"}, settings=settings)
    run(preset, tmp_path / "out")
    for setting in ("clean", "bright"):
        assert read(tmp_path / f"out/{setting}/box/results/frame000001.{image}").shape == (6, 8)


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_the_depth_scale_is_told_where_readers_look(tmp_path, layout):
    run(world(tmp_path / "w", layout, output={"depth_scale_per_m": 1000}), tmp_path / "out")
    folder = tmp_path / "out/clean/box"
    found = find_sequence(folder)
    assert found.depth_scale_per_m == 1000
    assert np.array_equal(read(found.depth_files[2]), np.rint(1000 * fake_depth_m(2)))
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert manifest["depth_scale_per_m"] == 1000
    assert manifest["depth_limit_m"] == 65.535
    if layout in ("replica", "tum"):
        camera = json.loads((tmp_path / "out/clean/cam_params.json").read_text())["camera"]
        assert camera["scale"] == 1000


@pytest.mark.parametrize(("beyond", "step"), [("void", 0), ("farthest", 65535)])
def test_what_lies_beyond_16_bits(tmp_path, beyond, step):
    output = {"image": "png", "depth_scale_per_m": 20000, "depth_beyond": beyond}  # up to 3.28 m
    settings = [{"name": "clean"}, {"name": "eroded", "perturb": [{"depth_edge_erosion": {"severity": 1}}]}]
    run(world(tmp_path / "w", "replica", output=output, settings=settings), tmp_path / "out")
    for setting in ("clean", "eroded"):
        depth = read(tmp_path / f"out/{setting}/box/results/depth000002.png")
        far = fake_depth_m(2) > 65535 / 20000
        assert 0.1 < far.mean() < 0.9
        assert (depth[far] == step).all()
        assert depth[0, 0] == 60000
    assert json.loads((tmp_path / "out/manifest.json").read_text())["depth_beyond"] == beyond


# --- read and written again ---


@pytest.mark.parametrize("layout", list(LAYOUTS))
def test_what_is_written_and_read_is_written_the_same_again(tmp_path, layout, monkeypatch):
    run(world(tmp_path / "w", layout, output={"colour": "rgb", "image": "png"}), tmp_path / "out")
    monkeypatch.setitem(sys.modules, "noisy_world.render.mesh_session", None)
    source = tmp_path / "out/clean/box"
    run(stored(tmp_path / "p", source, layout=layout, colour="rgb", image="png"), tmp_path / "again")
    names = names_in(source)
    assert names_in(tmp_path / "again/clean/box") == names
    for name in names:
        assert_alike(*((place / name).read_bytes() for place in (source, tmp_path / "again/clean/box")))


def assert_alike(one, other):
    """Files are the same but for numbers' last digits: a rotation goes by way of a quaternion and back."""
    if one != other:
        words, others = (re.split(r"[\s,]+", text.decode("ascii")) for text in (one, other))
        differ = [pair for pair in zip(words, others, strict=True) if pair[0] != pair[1]]
        assert np.allclose(*np.array(differ, dtype=float).T, rtol=0, atol=1e-12)


def test_from_tum_to_euroc_and_on_to_replica(tmp_path):
    preset = world(tmp_path / "w", "tum", settings=[{"name": "clean"}])
    override = write_tum_path(tmp_path / "w", ["1305031102.175304", "1305031102.211214", "1305031102.243211"])
    run(preset, tmp_path / "tum", overrides=[override])
    tum = tmp_path / "tum/clean/box"
    run(stored(tmp_path / "p", tum, layout="euroc"), tmp_path / "euroc")
    euroc = tmp_path / "euroc/clean/box"
    listed = [line.split() for line in (tum / "rgb.txt").read_text().splitlines() if not line.startswith("#")]
    for number, (stamp, name) in enumerate(listed):
        seconds, micro = stamp.split(".")
        stem = f"{int(seconds) * 10**9 + int(micro) * 1000:019d}"
        grey = read(euroc / f"mav0/cam0/data/{stem}.png")
        bgr = read(tum / name).astype(int)
        by_hand = (114 * bgr[..., 0] + 587 * bgr[..., 1] + 299 * bgr[..., 2]) / 1000
        assert np.abs(grey - by_hand).max() <= 0.5
        # The scale is TUM's own, so the very files are taken over.
        assert (euroc / f"mav0/depth0/data/{stem}.png").samefile(tum / f"depth/{number:06d}.png")
    truth = np.loadtxt(tum / "groundtruth.txt")
    stamps_ns, poses = states(euroc)
    assert stamps_ns == [1305031102175304000, 1305031102211214000, 1305031102243211000]
    assert np.allclose(poses[:, :3, 3], truth[:, 1:4], atol=1e-12)
    # Grey comes back as colour with three channels alike, unless grey is asked for: then it is the file itself.
    run(stored(tmp_path / "q", euroc, layout="replica", image="png"), tmp_path / "replica")
    run(stored(tmp_path / "g", euroc, layout="replica", image="png", colour="grey"), tmp_path / "grey")
    for k, stamp_ns in enumerate(stamps_ns):
        there = read(euroc / f"mav0/cam0/data/{stamp_ns}.png")
        back = read(tmp_path / f"replica/clean/box/results/frame{k:06d}.png")
        assert np.array_equal(back, np.repeat(there[..., None], 3, axis=2))
        taken = tmp_path / f"grey/clean/box/results/frame{k:06d}.png"
        assert taken.samefile(euroc / f"mav0/cam0/data/{stamp_ns}.png")
        depth = read(tmp_path / f"replica/clean/box/results/depth{k:06d}.png")
        assert np.abs(depth / 6553.5 - read(euroc / f"mav0/depth0/data/{stamp_ns}.png") / 5000).max() <= 0.5 / 6553.5


def test_intrinsics_that_the_sequence_tells_have_to_be_the_presets(tmp_path):
    run(world(tmp_path / "w", "euroc"), tmp_path / "out")
    preset = stored(tmp_path / "p", tmp_path / "out/clean/box")
    run(preset, tmp_path / "same")
    names = ["scenes.0.sequence: ", "fx 4, fy 4, cx 3.5, cy 2.5", "sensor.yaml", "fx 4.5,"]
    refused(run, preset, tmp_path / "other", overrides=["camera.fx=4.5"], names=names)


# --- removal ---

MINE = ("mav0/cam0/data/notes.txt", "mav0/imu1/data.csv", "results/mine.png", "rgb/mine.png", "mine.txt")


@pytest.mark.parametrize(("old", "new"), list(pairwise([*LAYOUTS, next(iter(LAYOUTS))])))
def test_overwriting_removes_the_old_layouts_files_and_no_other(tmp_path, old, new):
    keys = {"rig": RIG, "settings": [{"name": "clean"}, SHAKY]}
    run(world(tmp_path / "old", old, frames=5, **keys), tmp_path / "out")
    assert names_in(tmp_path / "out")
    for name in MINE:
        path = tmp_path / "out/shaky/box" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    preset = world(tmp_path / "new", new)
    run(preset, tmp_path / "out", overwrite=True)
    run(preset, tmp_path / "alone")
    assert content(tmp_path / "out").items() - content(tmp_path / "alone").items() == {
        (f"shaky/box/{name}", hashlib.sha256(b"mine").hexdigest()) for name in MINE
    }
    folders = {path.relative_to(tmp_path / "out/clean").as_posix() for path in (tmp_path / "out/clean").rglob("*")}
    alone = {path.relative_to(tmp_path / "alone/clean").as_posix() for path in (tmp_path / "alone/clean").rglob("*")}
    assert folders == alone  # empty folders of the old layout are gone too
