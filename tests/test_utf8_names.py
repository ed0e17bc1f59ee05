# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that are not UTF-8 are refused in a line, before anything is made, and reach no library in C."""

import ast
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from recorded_layouts import tum
from worlds import ROOT, write_world

from noisy_world.cli.command import COMMANDS, main
from noisy_world.dataset.identity import identity
from noisy_world.images.video_files import read_video, write_video
from noisy_world.core.errors import InputError
from noisy_world.preset.keys import check_document, read_preset
from noisy_world.core.file_access import ScratchFolder
from noisy_world.core.file_access import is_utf8, utf8_name
from noisy_world.dataset.plan import make_plan

PACKAGE = ROOT / "addon" / "noisy_world"
ODD = os.fsdecode(b"a\xff")
SAID = r"a\xff"  # as a shell's ls says it

# --- what comes in ---


def odd(path):
    """Give a file or folder of a test such a name; return the new path."""
    renamed = path.with_name(ODD + path.suffix)
    try:
        path.rename(renamed)
    except OSError:
        pytest.skip("this file system knows no such names")
    return renamed


def mesh(folder):
    odd(folder / "mesh.ply")
    return {"mesh": "*.ply", "trajectory": "traj.txt"}


def folder_of_a_mesh(folder):
    (folder / "room").mkdir()
    (folder / "mesh.ply").rename(folder / "room/mesh.ply")
    odd(folder / "room")
    return {"mesh": "*/mesh.ply", "trajectory": "traj.txt"}


def texture(folder):
    (folder / "wall.png").write_bytes(cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes())
    picture = odd(folder / "wall.png")
    (folder / "wall.mtl").write_bytes(b"newmtl wall\nmap_Kd " + os.fsencode(picture.name) + b"\n")
    (folder / "wall.obj").write_text("mtllib wall.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl wall\nf 1 2 3\n")
    return {"mesh": "wall.obj", "trajectory": "traj.txt"}


def materials(folder):
    (folder / "wall.mtl").write_text("newmtl wall\n")
    found = odd(folder / "wall.mtl")
    (folder / "wall.obj").write_bytes(
        b"mtllib " + os.fsencode(found.name) + b"\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl wall\nf 1 2 3\n"
    )
    return {"mesh": "wall.obj", "trajectory": "traj.txt"}


def sequence(folder):
    (folder / "recorded").mkdir()
    tum(folder / "recorded")
    odd(folder / "recorded")
    return {"sequence": "a*"}


def images(folder):
    (folder / "pictures").mkdir()
    (folder / "pictures/1.png").write_bytes(cv2.imencode(".png", np.zeros((36, 48, 3), np.uint8))[1].tobytes())
    odd(folder / "pictures")
    return {"sequence": "a*", "layout": "images"}


def video(folder):
    write_video(folder / "walk.avi", [np.full((48, 64, 3), 90, np.uint8)] * 2, 10.0)
    odd(folder / "walk.avi")
    return {"video": "*.avi"}


def blend(folder):
    (folder / "hall.blend").write_bytes(b"BLENDER")
    odd(folder / "hall.blend")
    return {"blend": "*.blend"}


@pytest.mark.parametrize("given", [mesh, folder_of_a_mesh, texture, materials, sequence, images, video, blend])
def test_what_a_preset_leads_to_is_refused_in_a_line(given, tmp_path):
    preset = write_world(tmp_path, frames=2, size=(48, 36))
    document = read_preset(preset).document | {"scenes": [given(tmp_path)], "output": {"modalities": ["rgb"]}}
    with pytest.raises(InputError) as raised:
        identity(make_plan(check_document(document, preset)), {})
    assert SAID in str(raised.value)
    assert "rename it" in str(raised.value)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_a_command_refuses_it_before_anything_is_made(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as raised:
        main([name, f"{ODD}.yaml", f"--out={ODD}"])
    (line,) = capsys.readouterr().err.splitlines()
    assert raised.value.code == 2
    assert SAID in line
    assert not list(tmp_path.iterdir())


def test_a_document_is_looked_at_before_it_is_json_or_yaml(tmp_path):
    document = read_preset(write_world(tmp_path, frames=2)).document
    document["scenes"][0]["mesh"] = f"{ODD}.ply"
    with pytest.raises(InputError) as raised:
        check_document(document, tmp_path / "panel.yaml")
    assert "scenes.0.mesh" in str(raised.value)
    assert SAID in str(raised.value)


def test_opencv_is_asked_for_no_video_of_such_a_name(tmp_path):
    write_video(tmp_path / "walk.avi", [np.zeros((48, 64, 3), np.uint8)], 10.0)
    found = odd(tmp_path / "walk.avi")
    for use in (lambda: read_video(found), lambda: write_video(found, [np.zeros((48, 64, 3), np.uint8)], 10.0)):
        with pytest.raises(InputError, match="not UTF-8"):
            use()


def test_a_scratch_folder_has_a_name_that_blender_takes(tmp_path, monkeypatch):
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(odd(tmp_path / "scratch")))
    with pytest.raises(Exception, match="TMPDIR") as raised:
        ScratchFolder(1)
    assert SAID in str(raised.value)


@pytest.mark.parametrize("name", ["hall.blend", "Räume/Küche.ply", "部屋.png", os.fsdecode(b"a\xff"), "\ud83d", "\0"])
def test_utf8_is_what_a_strict_decoder_takes(name):
    try:
        os.fsencode(name).decode()
    except UnicodeError:
        assert not is_utf8(name)
        with pytest.raises(InputError):
            utf8_name(Path(name))
    else:
        assert utf8_name(name) == name


# --- what goes out ---

# Calls and attributes by which a library in C opens a file by its name, which has to have passed the border.
CALLS = {
    "VideoCapture", "VideoWriter", "imread", "imreadmulti", "imwrite", "FileStorage", "save_render",
    "ComputeAllDependencies", "ExtractExternalReferences",
}  # fmt: skip
OPENERS = {("OpenEXR", "File"), ("Stage", "Open"), ("ImageInput", "open"), ("images", "load"), ("pictures", "load")}
NAMED = {"filepath", "directory"}
ATTRIBUTES = {"filepath", "filepath_raw", "directory"}
WORDS = CALLS | NAMED | ATTRIBUTES | {library for library, _ in OPENERS}
OWN = {"self", "entry"}  # properties of our own operators, which Blender does not open
ELSEWHERE = {"evaluate/programs": "run in other Pythons, without this package"}


def arounds_of(text):
    """Return the lines of a module at which a name goes to a library in C without having passed the border."""
    return sorted(node.lineno for node in ast.walk(ast.parse(text)) for name in names_given(node) if not passed(name))


def names_given(node):
    match node:
        case ast.Call(ast.Attribute(owner, name), [first, *_]) if name in CALLS or (last(owner), name) in OPENERS:
            values = [node.args[1]] if last(owner) == "pictures" else [first]
            yield from (each for each in values if not is_open_already(node, each))
        case ast.Call(ast.Attribute(ast.Attribute(), _)):
            yield from (each.value for each in node.keywords if each.arg in NAMED and first_of(node.func) != "self")
        case ast.Call(ast.Attribute(ast.Name(), "save")):
            yield from (each.value for each in node.keywords if each.arg == "filepath")
        case ast.Assign([*targets], value):
            for target in targets:
                if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                    yield from (each for place, each in zip(target.elts, value.elts, strict=False) if is_name(place))
                elif is_name(target):
                    yield value


def is_name(target):
    return isinstance(target, ast.Attribute) and target.attr in ATTRIBUTES and first_of(target) not in OWN


def is_open_already(call, argument):
    """Tell whether OpenEXR is given a stream or a header, and no name."""
    return call.func.attr == "File" and isinstance(argument, ast.Name)


def last(node):
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def first_of(node):
    while isinstance(node, ast.Attribute):
        node = node.value
    return getattr(node, "id", "")


def passed(name):
    return isinstance(name, ast.Constant) or (isinstance(name, ast.Call) and last(name.func) == "utf8_name")


def test_no_name_goes_around_the_border():
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        text = path.read_text(encoding="utf-8")
        if any(word in text for word in WORDS) and not any(name.startswith(f"{other}/") for other in ELSEWHERE):
            found += [f"{name}:{line}" for line in arounds_of(text)]
    assert not found, "give libraries in C utf8_name(path)"


@pytest.mark.parametrize(
    ("line", "around"),
    [
        ("cv2.VideoCapture(str(path))", True),
        ("cv2.VideoCapture(utf8_name(path))", False),
        ("cv2.imwrite(name, image)", True),
        ("OpenEXR.File(str(path), separate_channels=True)", True),
        ("OpenEXR.File(header, channels)", False),
        ("bpy.ops.wm.open_mainfile(filepath=path)", True),
        ("bpy.ops.wm.open_mainfile(filepath=utf8_name(path))", False),
        ("bpy.data.images.load(str(path))", True),
        ("image.save(filepath=str(file), save_copy=True)", True),
        ("scene.render.filepath = str(path)", True),
        ("image.filepath_raw = utf8_name(path)", False),
        ("file.directory, file.file_name = str(folder), name", True),
        ("entry.filepath, entry.part = str(path), part", False),
    ],
)
def test_the_rule_tells_what_goes_around(line, around):
    assert bool(arounds_of(line)) == around
