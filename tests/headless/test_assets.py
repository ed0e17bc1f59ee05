# SPDX-License-Identifier: GPL-3.0-or-later
"""The asset library: everything that the asset browser shows, and groups that work where there is no add-on."""

import json
import os
import shutil
import subprocess
import sys

import bpy
import numpy as np
import OpenEXR
import pytest
from group_tools import IDENTIFIERS, by_nodes, picture, step_of
from worlds import ROOT

sys.path.append(str(ROOT / "headless"))
from tools import assets, package

from noisy_world.core.errors import american
from noisy_world.nodes import node_trees
from noisy_world.nodes.chain import shown_values
from noisy_world.perturbations.groups import build_group
from noisy_world.perturbations.kinds import ColourPerturbation
from noisy_world.perturbations import registry

PERTURBATIONS = [item for item in registry().values() if isinstance(item, ColourPerturbation) and item.nodes]
BLENDER = os.environ.get("NOISY_WORLD_BLENDER", "")
SCRIPT = ROOT / "tests/headless/append_groups.py"


@pytest.fixture(scope="module")
def library(tmp_path_factory, building):
    """A copy of the library that the extension's build writes where its groups or their previews have changed."""
    folder = tmp_path_factory.mktemp("assets") / "library"
    with building():
        package.make_library()
        shutil.copytree(ROOT / "addon/noisy_world/assets", folder)
    return folder


def test_everything_that_the_asset_browser_shows(library):
    bpy.ops.wm.open_mainfile(filepath=str(library / "noisy_world_assets.blend"))
    trees = {tree.name: tree for tree in bpy.data.node_groups}
    marked = {name for name, tree in trees.items() if tree.asset_data is not None}
    assert marked == {build_group(item).name for item in PERTURBATIONS}
    catalogs = {}
    for line in (library / "blender_assets.cats.txt").read_text().splitlines():
        if ":" in line:
            identifier, path, _ = line.split(":")
            catalogs[identifier] = path
    stages = [f"Noisy World/{name}" for name in ("Environment", "Lens", "Sensor", "Post-processing")]
    assert set(catalogs.values()) == {*stages, *(f"{stage}/Benchmark" for stage in stages)}
    previews = set()
    for item in PERTURBATIONS:
        tree = trees[build_group(item).name]
        asset = tree.asset_data
        assert asset.description.startswith(american(item.sentence))
        assert ("Depth pass" in asset.description) == item.needs_depth
        tags = {tag.name for tag in asset.tags}
        overlay = item.about.of_paper or item.about.of_imagenet_c
        assert {item.name, "benchmark" if overlay else "physical"} <= tags
        assert ("depth" in tags) == item.needs_depth
        assert catalogs[asset.catalog_id].endswith("/Benchmark") == overlay
        assert catalogs[asset.catalog_id].split("/")[1].lower().startswith(item.stage[:4])
        pixels = np.empty(256 * 256 * 4, np.float32)
        tree.preview.image_pixels_float.foreach_get(pixels)
        assert pixels.std() > 0.01
        previews.add(pixels.tobytes())
    assert len(previews) == len(PERTURBATIONS)
    assert all(image.packed_file is not None for image in bpy.data.images if image.users)


def test_the_add_on_takes_its_groups_from_the_shelf(library, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(node_trees, "SHELF", library / assets.FILE)
    build = node_trees._build
    monkeypatch.setattr(node_trees, "_build", lambda graph: pytest.fail(f"{graph.name} is built"))
    node_trees._shelf.cache_clear()
    larger = {graph.name for graph in assets.larger_groups()}
    assert "Motion Blur (Radius 30)" in larger  # where its slider ends: half as much again as at severity 5
    assert set(node_trees._shelf().values()) == {build_group(item).name for item in PERTURBATIONS} | larger
    bpy.ops.wm.read_factory_settings(use_empty=True)
    found = [build_group(registry()[name]) for name in ("frost", "snow_depth", "brightness")]
    for graph in (*found, build_group(registry()["motion_blur"], {"radius_px": 30})):
        tree = node_trees.ensure_group(graph)
        assert (tree.name, tree[node_trees.STAMP], tree.asset_data, tree.library) == (
            graph.name,
            graph.stamp,
            None,
            None,
        )
        assert tree.preview is None or tuple(tree.preview.image_size) == (0, 0)
    assert not bpy.data.libraries
    # Where a user has linked a group of the shelf, it stays linked.
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library / assets.FILE), link=True) as (_, wanted):
        wanted.node_groups = ["Contrast"]
    monkeypatch.setattr(node_trees, "_build", build)
    own = node_trees.ensure_group(build_group(registry()["contrast"]))
    assert (own.library, wanted.node_groups[0].library.filepath) == (None, str(library / assets.FILE))
    (library / assets.FILE).with_suffix(".json").write_text("{}")
    node_trees._shelf.cache_clear()
    assert node_trees._shelf() == {}
    node_trees._shelf.cache_clear()


@pytest.mark.long
@pytest.mark.parametrize(
    "program",
    [
        [sys.executable],
        pytest.param(
            [BLENDER, "-b", "--factory-startup", "-P"],
            marks=pytest.mark.skipif(not BLENDER, reason="NOISY_WORLD_BLENDER names no Blender program"),
        ),
    ],
    ids=["wheel", "program"],
)
def test_appended_groups_work_without_the_add_on(library, tmp_path, program):
    rgb = picture(90, 130)
    np.save(tmp_path / "frame.npy", rgb)
    values = {}
    for item in PERTURBATIONS:
        sockets = shown_values(step_of(item.name, severity=3), 5, IDENTIFIERS)
        values[build_group(item).name] = sockets | {"Encoded": True, "Clip": True, "Reference Width": 130}
    (tmp_path / "values.json").write_text(json.dumps(values))
    words = ["--", library / "noisy_world_assets.blend", tmp_path / "frame.npy", tmp_path / "values.json", tmp_path]
    command = [*program, str(SCRIPT), *map(str, words)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert f"appended {len(PERTURBATIONS)} {len(PERTURBATIONS)}" in result.stdout, result.stdout + result.stderr
    with OpenEXR.File(str(tmp_path / "groups.exr"), separate_channels=True) as layers:
        channels = {name: part.pixels for name, part in layers.channels().items()}
    depth_m = np.full(rgb.shape[:2], 2.0, np.float32)
    for item in PERTURBATIONS:
        name = build_group(item).name.replace(" ", "_")
        found = np.stack([channels[f"{name}.{axis}"] for axis in "XYZ"], axis=-1)
        (wanted,) = by_nodes(item.name, rgb, [5], severity=3, depth_m=depth_m)
        assert np.array_equal(found, wanted), item.name
