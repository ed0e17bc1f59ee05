# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of a measured recording: offline, small, well-formed, and safe from what files are called."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from noisy_world.cli import command
from noisy_world.measure.charts import map_chart
from noisy_world.measure.figure import Figure, Place
from noisy_world.measure.looking import RecordingFigures
from noisy_world.measure.measure_page import page
from noisy_world.measure.model_draw import ModelDraw
from noisy_world.measure.twin import Twin

EVIL = "<script>alert('x')</script>&\"\n\x1b"


def told(*figures):
    return {figure.name: figure for figure in figures}


def spectrum(times):
    made = [Figure.within(f"gyro_spectrum_at_{at}_hz", times / at, 0.1 / at, 8) for at in (1.0, 10.0, 1000.0)]
    return [figure.on("gyro_spectrum", at) for figure, at in zip(made, (1.0, 10.0, 1000.0), strict=True)]


def made(draw, *, places=(), figures=None):
    figures = draw.measured if figures is None else figures
    found = RecordingFigures(EVIL, 9, (8, 6), 1.0, 9, figures, (EVIL,), ("x",), (EVIL,), places)
    return page(EVIL, found, Twin({}, untold=[EVIL]), draw)


def test_a_page_fetches_nothing_and_keeps_what_files_say_harmless():
    measured = told(
        *spectrum(1.0),
        Figure.none("colour_gaussian_std", EVIL),
        Figure("depth_late_frames", -2.0, -2.5, -1.5, 9),
        Figure.exact("void_share", 0.1, 9, EVIL),
    )
    draw = ModelDraw(measured, told(*spectrum(0.2), Figure.exact("void_share", 0.12, 9)), (np.eye(3), np.zeros((3, 3))))
    places = Place("motion_blur", 2.6, 2.0, 3.0, 0.4, EVIL), Place("axial_noise", 5.0, None, None, 3.0)
    shown = made(draw, places=places)
    assert len(shown.encode()) < 60_000
    assert not re.search(r"https?:|<script|\bsrc=|@import|url\(|\x1b", shown)
    assert "axial_noise beyond 5, 3 times its strength" in shown
    drawings = re.findall(r"<svg.*?</svg>", shown, re.DOTALL)
    assert len(drawings) == 5  # severities, a spectrum, two maps, offsets
    for drawing in drawings:
        ElementTree.fromstring(drawing)
    # Powers of ten are as far apart on both axes as they have to be: the law 1 / f is a straight line.
    points = [(float(x), float(y)) for x, y in re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)" r="3.5"', shown)]
    (x0, y0), (x1, y1), (x2, y2) = points
    assert (x2 - x0) / (x1 - x0) == pytest.approx(3, rel=0.01)
    assert (y2 - y0) / (y1 - y0) == pytest.approx(3, rel=0.01)


def test_a_page_of_little_says_what_there_is_not():
    shown = made(ModelDraw({}, {}, None), figures=told(Figure.none("depth_late_frames", "there is no depth")))
    for words in ("It cannot be told.", "There is no depth.", "None can be told.", "has a place there"):
        assert words in shown
    assert "cannot be told here, because there is no depth" in shown


def test_a_map_has_a_rectangle_for_each_run_of_equal_cells():
    drawn = map_chart("holes", np.array([[0.0, 1.0, 1.0], [0.5, 0.5, 0.5]]))
    assert re.findall(r'fill="(#\w+)" d="(M\d \d)h(\d)', drawn)[1:] == [
        ("#000000", "M1 0", "2"),
        ("#808080", "M0 1", "3"),
    ]


@pytest.mark.parametrize(
    ("name", "said"),
    [("page.txt", "has to end in .html"), ("folder.html", "is a folder"), ("no/p.html", "is no folder")],
)
def test_a_page_that_cannot_be_written_is_refused(tmp_path, capsys, name, said):
    (tmp_path / "folder.html").mkdir()
    assert command.main(["measure", str(tmp_path), "--html", str(tmp_path / name)]) == 1
    assert said in capsys.readouterr().err
