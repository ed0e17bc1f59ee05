# SPDX-License-Identifier: GPL-3.0-or-later
"""Fifty mistakes of somebody who has read the first pages: each is one line that ends in the remedy."""

import pytest
from worlds import ROOT

from noisy_world.cli import command

TOUR = (ROOT / "docs/examples/tour.yaml").read_text(encoding="utf-8")
# The preset of the tutorial with one thing wrong: what is written instead of what, and how the line ends.
IN_THE_PRESET = {
    "seed: 11 -> sead: 11": "sead: unknown key 'sead'; did you mean 'seed'?",
    "{motion_blur: -> {motion_blurr:": "unknown perturbation 'motion_blurr'; did you mean 'motion_blur'?",
    "severity: 3 -> severity: 9": "motion_blur.severity: is 9, out of range; allowed: 0, or 1 to 5",
    "severity: 3 -> severty: 3": "unknown key 'severty'; did you mean 'severity'?",
    "width: 640 -> width: 640.5": "camera.width: is the number 640.5, but has to be a whole number",
    "offset: -4 -> offset: four": "desync.offset: is the text 'four', but has to be a whole number",
    '"embedded:room" -> room.ply': "scenes.0.mesh: no such file: room.ply; paths are relative to the preset",
    "embedded:room -> embedded:rooom": "did you mean 'embedded:room', or embedded:room?seed=0 to 7?",
    "layout: tum -> layout: tumm": "output.layout: unknown value 'tumm'; did you mean 'tum'?",
    "image: png -> image: bmp": "output.image: unknown value 'bmp'; known here: jpg, png, exr",
    "frames: 120 -> frames: 0": "handheld.frames: is 0 frames, out of range; allowed: 1 to 1000000 frames",
    "samples: 1 -> samples: 0": "render.samples: is 0, out of range; allowed: 1 to 65536",
    "handheld: {frames: 120, rate_hz: 15} -> file: walk.txt": "walk.txt; paths are relative to the preset",
    "name: noisy -> name: clean": "settings.1.name: 'clean' is given twice; give one another name",
    "name: noisy -> name: a/b": "letters, digits, dot, dash and underscore, a letter or digit first",
    "seed: 11 -> seed: 11\n  x: [}": "mapping values are not allowed here; mend this line, or the one before it",
    "[{desync: {offset: -4}}] -> {desync: {offset: -4}}": "is a mapping, but has to be a list; put it in [ ]",
    "{severity: 3} -> {severity: strong}": "is the text 'strong', but has to be a severity; allowed: 0, or 1 to 5",
    "fx: 525 -> fx: 0.00525": "give focal length and principal point in pixels of the image",
    "cx: 319.5 -> cx: 51950": "give focal length and principal point in pixels of the image",
    "backend: reference -> backend: cycles": "unknown value 'cycles'; known here: compositor, reference",
}
# Words on the command line, and how the line ends. notes is a folder with a text, empty.yaml an empty file.
IN_THE_WORDS = {
    "generate toor.yaml": "no such preset; did you mean 'tour.yaml'?",
    "generate notes": "not a file; name a YAML file; 'noisy-world list presets' names those that are shipped",
    "generate empty.yaml": "empty.yaml: is empty; see --list keys",
    "generate tour.yaml --dry-run --set camera.with=3": "camera.with: unknown key 'with'; did you mean 'width'?",
    "generate tour.yaml --dry-run --set camera.width": "--set camera.width: has to be key.path=value",
    "generate tour.yaml --dry-run --settings fog": "matches none of 3 settings; near it: clean, noisy, late_depth",
    "generate tour.yaml --dry-run --frames 500:600": "chooses none of the 120 frames of room; choose from 0:120",
    "generate tour.yaml --dry-run --set scenes.0.mesh=empty.yaml": "empty.yaml: is empty; copy or export it again",
    "check walk": "walk/depth.txt: is not there, though depth/ is; write it like rgb.txt, or remove depth/",
    "status nowhere": "nowhere: there is no such folder; name the folder that generate wrote",
    "status notes": "nor one that was begun; name the folder that generate wrote",
    "view notes --html look.pdf": "look.pdf: is no name of a page; let it end in .html",
    "video notes walk.mov": "walk.mov: ends in .mov; name a file that ends in .mp4 or .avi or .mkv",
    "score estimate.txt truth.txt": "truth.txt: does not exist; name a file of poses that is there",
    "report notes": "is not there; the folder that 'noisy-world evaluate --out' wrote is needed",
    "check notes": "or a preset says where its files are: sequence: {folder, rgb, depth, poses, intrinsics}",
    "systems install orb_slam9": "unknown system 'orb_slam9'; did you mean 'orb_slam3'?",
    "publish notes out": "notes: holds no dataset of Noisy World; name the folder that generate wrote",
    "scan tour.yaml notes": "notes: is there already; choose another folder, or remove it",
    "example tuor": "tuor: no such example; did you mean 'tour'?",
    "docs tutorail": "tutorail: no such page; did you mean 'tutorial'?",
    "describe fogg": "fogg: nothing has this name; did you mean 'fog'?",
    "list metrics ate_rmse": "no such metric; did you mean 'ate_rmse_m'?",
    "generat tour.yaml": "'generat' is no subcommand; did you mean 'generate'?",
}
# What the parser ends with.
IN_THE_OPTIONS = {
    "generate": "name a preset, presets/demo.yaml for instance; 'noisy-world generate --help' tells more",
    "generate tour.yaml --outt x": "unknown option --outt; did you mean --out?",
    "generate tour.yaml --frames 5": "'5' has to be A:B, two frame numbers of which either may be left out; ",
    "generate tour.yaml --jobs 0": "'0' has to be a whole number from 1 up; ",
    "evaluate tour.yaml": "name the systems with --systems, rgbd_odometry for instance; ",
    "list keyss": "'keyss' is none of its values; did you mean 'keys'?",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tour.yaml").write_text(TOUR)
    (tmp_path / "empty.yaml").write_text("")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes/readme.txt").write_text("hello")
    (tmp_path / "walk/depth").mkdir(parents=True)
    (tmp_path / "walk/rgb.txt").write_text("0.0 rgb/0.png\n")
    return tmp_path


def one_line(capsys):
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    return said.err


def test_they_are_fifty():
    assert len(IN_THE_PRESET) + len(IN_THE_WORDS) + len(IN_THE_OPTIONS) >= 50


@pytest.mark.parametrize("change", IN_THE_PRESET)
def test_in_the_preset(change, folder, capsys):
    old, _, new = change.partition(" -> ")
    assert old in TOUR
    (folder / "mine.yaml").write_text(TOUR.replace(old, new, 1))
    assert command.main(["generate", "mine.yaml", "--dry-run"]) == 1
    line = one_line(capsys)
    assert line.startswith("noisy-world generate: mine.yaml: ")
    assert line.rstrip().endswith(IN_THE_PRESET[change])


@pytest.mark.parametrize("words", IN_THE_WORDS)
def test_in_the_words(words, folder, capsys):
    assert command.main(words.split()) in (1, 2)
    assert IN_THE_WORDS[words] in one_line(capsys)


@pytest.mark.parametrize("words", IN_THE_OPTIONS)
def test_in_the_options(words, folder, capsys):
    with pytest.raises(SystemExit) as ended:
        command.main(words.split())
    assert ended.value.code == 2
    assert IN_THE_OPTIONS[words] in one_line(capsys)
