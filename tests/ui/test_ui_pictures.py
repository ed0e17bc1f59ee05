# SPDX-License-Identifier: GPL-3.0-or-later
"""The small pictures of presets and perturbations: one of each, small in all, and nothing wrong where one lacks."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import cv2
import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

from noisy_world.perturbations import registry
from noisy_world.panel import gallery
from noisy_world.panel.gallery import listed, shipped_folder

MOST_BYTES = 300_000


class Previews(dict):
    """Pictures with numbers, which Blender gives them only where it has a window."""

    def load(self, key, path, kind):
        assert kind == "IMAGE"
        assert Path(path).is_file()
        self[key] = SimpleNamespace(icon_id=1 + len(self))
        return self[key]


@pytest.fixture(autouse=True)
def previews(add_on, monkeypatch):
    made = Previews()
    monkeypatch.setattr(gallery, "_loaded", {"pictures": made})
    yield made
    gallery._loaded.clear()


class Drawn:
    """A layout that counts what is drawn into it."""

    def __init__(self):
        self.icons, self.buttons, self.operator_context = [], [], ""

    def _itself(self, **_):
        return self

    grid_flow = column = _itself

    def label(self, **_):
        pass

    def separator(self, **_):
        self.icons.append(0)

    def template_icon(self, *, icon_value, scale):
        assert scale > 1
        self.icons.append(icon_value)

    def operator(self, name, *, text):
        self.buttons.append((name, text))
        return SimpleNamespace()


def drawn(name):
    layout = Drawn()
    (cls,) = [cls for cls in gallery.CLASSES if cls.__name__ == name]
    cls.draw(SimpleNamespace(layout=layout), bpy.context)
    return layout


def test_every_shipped_preset_and_perturbation_has_one_and_no_other_is_there():
    presets = [path.with_suffix(".jpg") for path in listed(shipped_folder())]
    wanted = {path.relative_to(shipped_folder()).as_posix() for path in presets}
    wanted |= {f"perturbations/{name}.jpg" for name in registry()}
    files = [path for path in gallery.THUMBNAILS.rglob("*") if path.is_file()]
    assert {path.relative_to(gallery.THUMBNAILS).as_posix() for path in files} == wanted
    assert sum(path.stat().st_size for path in files) < MOST_BYTES
    shapes = {cv2.imread(str(path)).shape for path in files}
    assert len(shapes) == 1


def test_the_lists_show_them_with_a_button_each(previews):
    shown = [drawn(name) for name in (*gallery.POPOVERS.values(), gallery.PRESETS)]
    assert all(len(layout.icons) == len(layout.buttons) > 10 for layout in shown)
    icons = [icon for layout in shown for icon in layout.icons]
    assert 0 not in icons
    assert len(set(icons)) == len(icons)
    assert drawn(gallery.PRESETS).icons == shown[-1].icons
    assert len(previews) == len(icons)  # each is loaded once


def test_one_without_is_listed_by_its_name_and_ones_own_stands_beside_its_file(tmp_path, monkeypatch):
    own = tmp_path / "own"
    own.mkdir()
    for name in ("bare", "mine"):
        shutil.copy(shipped_folder() / "demo.yaml", own / f"{name}.yaml")
    shutil.copy(gallery.THUMBNAILS / "demo.jpg", own / "mine.jpg")
    monkeypatch.setattr(gallery, "own_folder", lambda: own)
    monkeypatch.setattr(gallery, "THUMBNAILS", Path(tmp_path / "none"))
    layout = drawn(gallery.PRESETS)
    assert [text for _, text in layout.buttons][:3] == ["bare", "mine", "Benchmark"]
    assert layout.icons[0] == 0
    assert layout.icons[1] > 0
    assert set(layout.icons[2:]) == {0}
