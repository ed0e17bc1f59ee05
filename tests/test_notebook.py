# SPDX-License-Identifier: GPL-3.0-or-later
"""The notebook runs as it stands, and makes of other images what its page says; Jupyter is not needed for that."""

import json
import re
import shutil
import sys
from types import ModuleType

import cv2
import numpy as np
import pytest
from worlds import ROOT

NOTEBOOK = ROOT / "docs/examples/own_images.ipynb"
PAGE = ROOT / "docs/own_images.md"


def cells(kind):
    found = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in found if cell["cell_type"] == kind]


def run(monkeypatch, folder, **changed):
    """Run all cells in a folder, with other values of the names that a cell begins with; return what they defined."""
    shown = []
    display = ModuleType("IPython.display")
    display.Image = lambda *, filename: shown.append(filename)
    monkeypatch.setitem(sys.modules, "IPython", ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.chdir(folder)
    defined = {}
    code = "\n".join(cells("code"))
    for name, value in changed.items():
        code, count = re.subn(rf"^{name} = .*$", lambda _, n=name, v=value: f"{n} = {v!r}", code, flags=re.MULTILINE)
        assert count == 1, name
    exec(compile(code, NOTEBOOK.name, "exec"), defined)
    return defined | {"shown": shown}


def frames_of(path):
    reader = cv2.VideoCapture(str(path))
    found = []
    while (read := reader.read())[0]:
        found.append(read[1])
    return np.array(found)


def test_the_page_shows_the_cells():
    blocks = re.findall(r"```python\n(.*?)\n```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    installing, shown = cells("code")[:2], cells("code")[2:]
    assert shown == blocks
    assert "pip" in installing[1]  # what a notebook elsewhere begins with


def test_the_notebook_runs_as_it_stands(tmp_path, monkeypatch):
    for name in ("gallery/room.jpg", "street.mp4"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / "docs" / name, tmp_path / name)
    (tmp_path / "examples").mkdir()
    assert run(monkeypatch, tmp_path / "examples")["shown"] == ["noisy.jpg"]
    noisy, clean = (cv2.imread(str(tmp_path / name)) for name in ("examples/noisy.jpg", "gallery/room.jpg"))
    assert noisy.shape == clean.shape
    # Fog takes contrast between parts of the image, noise adds some between neighbours.
    means = [cv2.resize(image, (14, 8), interpolation=cv2.INTER_AREA).std() for image in (noisy, clean)]
    steps = [np.abs(np.diff(image.astype(float), axis=1)).mean() for image in (noisy, clean)]
    assert means[0] < 0.8 * means[1]
    assert steps[0] > 1.5 * steps[1]
    film, made = frames_of(tmp_path / "street.mp4"), frames_of(tmp_path / "examples/noisy.mp4")
    assert made.shape == (12, *film.shape[1:])
    assert np.abs(made.astype(float) - film[:12]).mean(axis=(1, 2, 3)).min() > 10


def test_noise_is_as_strong_as_the_paper_says(tmp_path, monkeypatch):
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((200, 300, 3), 128, np.uint8))
    defined = run(
        monkeypatch,
        tmp_path,
        SOURCE="grey.png",
        NOISE=[("gaussian_noise", {"severity": 1})],
        VIDEO=str(ROOT / "docs/street.mp4"),
        FRAMES=2,
    )
    assert defined["made"].std() == pytest.approx(0.08 * 255, rel=0.02)
    assert len(frames_of(tmp_path / "noisy.mp4")) == 2
