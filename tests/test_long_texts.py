# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of strangers take time in proportion to their length: no pattern tries again what another has tried."""

import contextlib
import random
import re
import time

from cases import cases

from noisy_world.core.errors import InputError
from noisy_world.scenes.mesh_files import check_numbers
from noisy_world.trajectories.pose_columns import _column_names
from noisy_world.trajectories.transforms_json import _order_notes
from noisy_world.dataset.recipe import series_of
from noisy_world.sources.scene_kinds import _parts_of_name

N = 100_000


def arrays(folder, text):
    (folder / "a.fbx").write_text("; FBX \n" + text)
    with contextlib.suppress(InputError):
        check_numbers(folder / "a.fbx")


@cases(
    ("read", "text"),
    [
        (series_of, "1" * N),
        (series_of, "1." * N + "a1.b"),
        (_column_names, "# x" + " " * N + "y"),
        (lambda text: _order_notes([{"file_path": text}]), "1" * N + "a/" + "1" * N + "b1c"),
        (lambda text: _order_notes([{"file_path": text}]), ("1" * 200 + "a") * 500),
        (lambda text: _parts_of_name(text, "a"), "[" * N),
        (lambda text: _parts_of_name(text, "a"), "]" + "[" * N),
    ],
)
def test_time_in_proportion(read, text):
    began = time.process_time()
    read(text)
    assert time.process_time() - began < 0.5


def test_arrays_of_fbx(tmp_path):
    began = time.process_time()
    arrays(tmp_path, "Vertices: " * N)
    arrays(tmp_path, "Vertices: {" * N)
    arrays(tmp_path, "Vertices: { a: " * N)
    assert time.process_time() - began < 1


def test_the_series_of_an_image_is_what_it_was():
    rng = random.Random(1)
    names = [
        "".join(rng.choices("019.ab/", k=rng.randrange(12))) + rng.choice((".jpg", ".png", "")) for _ in range(5000)
    ]
    assert [series_of(name) for name in names] == [re.sub(r"[0-9][0-9.]*(?=\.[a-z]+$)", "*", name) for name in names]
