# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of exposures: in records, of the colour's where depth is another frame's; of those that are too long."""

import json
import sys
from itertools import pairwise

import numpy as np
import pytest
from test_rolling_shutter import poses_at
from worlds import write_replica, write_world
from runs import run

pytest.importorskip("embreex", reason="embreex is not installed: make .venv/.extras brings it")

import noisy_world
from noisy_world.core.progress import PlainProgress
from noisy_world.dataset.recipe import recipe_of

BLUR = {"camera_motion_blur": {"shutter_ms": 40}}
LATE = {"desync": {"offset": 2}}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("late")
    preset = write_world(
        folder,
        size=(32, 24),
        settings=[{"name": "blurred", "perturb": [BLUR]}, {"name": "late", "perturb": [BLUR, LATE]}],
        render={"engine": "embree", "backend": "reference"},
        output={"layout": "replica", "image": "png"},
    )
    write_replica(folder / "traj.txt", poses_at([0.0, 0.05, 0.1, 0.4, 0.45, 0.9]))  # slow, then fast
    run(preset, folder / "out")
    return preset, folder / "out"


def lines_of(out, setting):
    return [json.loads(line) for line in (out / f"{setting}/box/frames.jsonl").read_text().splitlines()]


def test_the_record_is_of_the_colours_exposure(made):
    _, out = made
    blurred, late = (
        [line["perturbed"]["exposure"][0]["moments"] for line in lines_of(out, name)] for name in ("blurred", "late")
    )
    assert len(set(blurred)) > 2  # each frame goes another way
    assert late == blurred


@pytest.mark.parametrize("image", ["frame000001.png", "depth000001.png"])
def test_it_is_the_same_whichever_image_is_made_last(made, image):
    preset, out = made
    records = out / "late/box/frames.jsonl"
    before = records.read_bytes()
    (out / "late/box/results" / image).unlink()
    assert run(preset, out).frames_rendered == 1
    assert (out / "late/box/results" / image).exists()
    assert records.read_bytes() == before


def test_a_recipe_says_it_too(made):
    preset, out = made
    path = preset.parent / "late.recipe.json"
    path.write_text(recipe_of(out, PlainProgress(sys.stderr)).text())
    for name in ("blurred/box", "late/box"):
        there, again = (noisy_world.open(each)[name][1].done for each in (out, path))
        assert "exposure" in there
        assert again == there


def rolled(folder, readout_ms, **keys):
    preset = write_world(
        folder,
        size=(64, 48),
        settings=[{"name": "rolled", "perturb": [{"rolling_shutter": {"readout_ms": readout_ms}}]}],
        render={"engine": "embree", "backend": "reference"},
        **keys,
    )
    # Seven degrees from the first line to the last: a vertex that one pose puts left of an edge is right of it.
    write_replica(folder / "traj.txt", poses_at(np.arange(4) / 5.0))
    return preset


def write_fence(path):
    """Posts 0.1 m wide and 0.2 m apart, 2 m ahead, each cut into 100 pieces; nothing is behind them but a wall."""
    heights = np.linspace(-3, 5, 101)
    posts = [(2.0, y, y + 0.1, heights) for y in np.arange(-4, 4, 0.3)] + [(4.0, -20, 20, heights[[0, -1]])]
    vertices, faces = [], []
    for x, left, right, at in posts:
        for low, high in pairwise(at):
            faces.append(f"4 {len(vertices)} {len(vertices) + 1} {len(vertices) + 2} {len(vertices) + 3}")
            vertices += [f"{x} {y} {z}" for y, z in ((left, low), (right, low), (right, high), (left, high))]
    head = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
    ]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    path.write_text("\n".join([*head, *vertices, *faces]) + "\n")


def test_lines_of_many_poses_are_not_held_against_one(tmp_path):
    preset = rolled(tmp_path / "world", 49.9)
    write_fence(tmp_path / "world/mesh.ply")
    notes = run(preset, tmp_path / "out").notes
    assert not [note for note in notes if "went wrong" in note or "no camera" in note]


def test_what_no_camera_does_is_said(tmp_path):
    notes = run(rolled(tmp_path / "world", 80), tmp_path / "out").notes
    said = "rolled: readout of 80 ms is longer than the 50 ms between frames of box, which no camera does"
    assert [note.split(";")[0] for note in notes if "no camera" in note] == [said]
