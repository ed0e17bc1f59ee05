# SPDX-License-Identifier: GPL-3.0-or-later
"""The package of docs/examples/my_lab: a source, two layouts, a metric and more, all by entry points."""

import ast
import csv
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from functools import partial

import cv2
import installed_package
import numpy as np
import pytest
from worlds import ROOT, generate, path_poses, write_world

from noisy_world.dataset.identity import identity_problem
from noisy_world.layouts import EVERY
from noisy_world.preset.keys import read_preset
from noisy_world.core.errors import NoisyWorldError

for package in ("embreex", "tabulate", "pandas", "jinja2", "matplotlib"):
    pytest.importorskip(package, reason=f"{package} comes with the extra evaluate")

EXAMPLE = ROOT / "docs/examples/my_lab"
PROJECT = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MODULES = {
    file.relative_to(EXAMPLE / "my_lab").as_posix(): file.read_text(encoding="utf-8")
    for file in sorted((EXAMPLE / "my_lab").rglob("*.*"))
    if file.suffix in (".py", ".yaml")
}
TESTS = (EXAMPLE / "test_rules.py").read_text(encoding="utf-8")
NAMES = ("corridor", "flat", "phone", "odometer", "facing", "upward", "strays", "holes", "helmet", "systems/still")
CORRIDOR, FLAT, PHONE, ODOMETER, FACING, UPWARD, STRAYS, HOLES, HELMET, STILL = (
    MODULES[f"{name}.py"] for name in NAMES
)
FRAMES = 5
RENDER = {"engine": "embree", "backend": "reference"}
# All in one process, as one that starts takes longer than what it does.
PROGRAM = """
import sys
from noisy_world.cli import command
for words in (
    ["list", "layouts"],
    ["list", "formats"],
    ["list", "sources"],
    ["list", "metrics"],
    ["list", "cameras"],
    ["list", "keys"],
    ["generate", "hall/preset.yaml", "--out", "hall_out"],
    ["generate", "hall/preset.yaml", "--out", "hall_out"],
    ["systems"],
    ["generate", "made/preset.yaml", "--out", "flat"],
    ["generate", "made/preset.yaml", "--out", "flat"],
    ["generate", "read/preset.yaml", "--out", "tum"],
    ["evaluate", "flat", "--systems", "still", "--out", "results"],
    ["holes", "flat"],
):
    print(">", *words, flush=True)
    if command.main(words):
        sys.exit(f"{words} ended with an error")
for change in ("width_m=5", "widht_m=5"):
    words = ["generate", "hall/preset.yaml", "--out", "hall_out", "--set", f"scenes.0.corridor.{change}"]
    if command.main(words) != 1:
        sys.exit(f"{words} was not refused")
if command.main(["hole"]) != 2:
    sys.exit("there is no subcommand hole")
print("> help")
print(command.help_text())
import os, pathlib, my_lab_tests
os.chdir("tested")
for name in ("corridor", "flat", "odometer", "upward", "still"):
    pathlib.Path("..", name + "_works").mkdir()
my_lab_tests.test_corridor(pathlib.Path("../corridor_works"))
my_lab_tests.test_flat(pathlib.Path("../flat_works"))
my_lab_tests.test_phone()
my_lab_tests.test_odometer(pathlib.Path("../odometer_works"))
my_lab_tests.test_facing()
my_lab_tests.test_upward()
my_lab_tests.test_strays()
my_lab_tests.test_still(pathlib.Path("../still_works"))
"""


def write_phone(folder):
    """Write what the phone records: its depth is 2 m and 1 cm more with each frame."""
    folder.mkdir()
    for k, c2w in enumerate(path_poses(FRAMES)):
        assert cv2.imwrite(str(folder / f"color_{k}.png"), np.full((24, 32, 3), 40 + k, np.uint8))
        assert cv2.imwrite(str(folder / f"depth_{k}.png"), np.full((24, 32), 2000 + 10 * k, np.uint16))
        np.savetxt(folder / f"pose_{k}.txt", c2w)


@pytest.fixture(scope="module")
def worked(tmp_path_factory):
    """Where the program has run, and what it said."""
    folder = tmp_path_factory.mktemp("work")
    groups = {name.removeprefix("noisy_world."): entries for name, entries in PROJECT["entry-points"].items()}
    site = installed_package.install(folder / "site", PROJECT["name"], PROJECT["version"], groups, MODULES, kind=None)
    noise = [{"name": "clean"}, {"name": "noise", "perturb": [{"depth_gaussian_noise": {"severity": 3}}]}]
    output = {"layout": "flat", "depth_scale_per_m": 2000}
    write_world(folder / "made", frames=FRAMES, size=(32, 24), settings=noise, render=RENDER, output=output)
    write_phone(folder / "phone")
    hall = [{"name": "hall", "corridor": {"width_m": 3, "frames": FRAMES}}]
    away = {"name": "away", "perturb": [{"motion_deviation": {"rotation_deg": 0, "translation_m": 0.05}}]}
    write_world(folder / "hall", size=(32, 24), scenes=hall, settings=[{"name": "clean"}, away], render=RENDER)
    (site / "my_lab_tests.py").write_text(TESTS)  # which are run from the package's own folder
    (folder / "tested").mkdir()
    (folder / "tested/my_lab").symlink_to(site / "my_lab")
    (site / "a_recording").symlink_to(folder / "phone")
    scenes = [
        {"name": "flat", "sequence": str(folder / "flat/clean/box")},
        {"name": "phone", "sequence": str(folder / "phone")},
    ]
    camera = {"width": 32, "height": 24, "fx": 16, "fy": 16, "cx": 15.5, "cy": 11.5}
    write_world(
        folder / "read", size=(32, 24), scenes=scenes, settings=noise[:1], output={"layout": "tum"}, camera=camera
    )
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        text=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(site), str(ROOT / "addon")])},
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    said = dict(re.findall(r"^> (.+)\n((?:(?!> ).*\n)*)", result.stdout, re.MULTILINE))
    return folder, said | {"refused": result.stderr}


def depth_steps(file):
    found = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    assert found is not None, file
    return found.astype(int)


def is_listed(said, what, name, line):
    return re.search(rf"^{re.escape(name)} +{re.escape(line)}; from my-lab 1.0$", said[f"list {what}"], re.MULTILINE)


def test_lists_have_them(worked):
    _, said = worked
    listed = partial(is_listed, said)
    assert listed("layouts", "flat", "Flat, all images in one folder, each pose in a file")
    assert listed("layouts", "phone", "Our phone: what our phone records; depth in mm; only read, as sequence: FOLDER")
    assert listed("formats", "odometer", "Odometer: Milliseconds, x, y and heading, separated by semicolons")
    assert re.search(r"^scenes\[\]\.trajectory\.format .*one of auto, .*odometer", said["list keys"], re.MULTILINE)
    assert listed("metrics", "map.accuracy_max_m", "accuracy, max [m], lower is better")
    assert listed("cameras", "helmet", "Helmet Camera: a global shutter that sees wide")
    assert "still (from my-lab 1.0): can be run here\n" in said["systems"]


def test_a_subcommand_is_run_and_told(worked):
    folder, said = worked
    holes = {line.partition(": ")[0]: line for line in said["holes flat"].splitlines()}
    depths = [depth_steps(folder / f"flat/clean/box/{k:06d}_depth.png") for k in range(FRAMES)]
    assert holes["clean/box"] == f"clean/box: {np.mean([(depth == 0).mean() for depth in depths]):.1%} void"
    group = said["help"].partition("look at what there is:\n")[2].partition("\n\n")[0]
    assert re.search(r"^  holes +say how much of a dataset's depth is void; from my-lab 1.0$", group, re.MULTILINE)
    assert "'hole' is no subcommand; did you mean 'holes'?" in said["refused"]


def corridor_depth_m(c2w, half_m=1.5):
    """Planar depth at the centres of the pixels of write_world's camera, of walls around the world's z."""
    x, y = (np.arange(32)[None, :] - 15.5) / 16, (np.arange(24)[:, None] - 11.5) / 16
    sides = (np.sign(x) * half_m - c2w[0, 3]) / x
    ceiling = (np.sign(y) * half_m - c2w[1, 3]) / y
    return np.minimum(np.minimum(sides, ceiling), 100.0)


def test_scenes_come_from_the_source(worked):
    folder, said = worked
    assert is_listed(said, "sources", "corridor", "Corridor: a corridor of striped walls, along which a camera sways")
    assert re.search(
        r"^scenes\[\]\.corridor\.width_m +from wall to wall, .*; default 4\.0$", said["list keys"], re.MULTILINE
    )
    identity = json.loads((folder / "hall_out/manifest.json").read_text())["identity"]
    assert identity["versions"]["my-lab"] == "1.0"
    assert identity["scenes"]["hall"]["keys"] == {"corridor.frames": FRAMES, "corridor.width_m": 3.0}
    for setting in ("clean", "away"):
        results = folder / "hall_out" / setting / "hall"
        poses = np.loadtxt(results / "traj.txt").reshape(-1, 4, 4)
        for k, c2w in enumerate(poses):
            written = depth_steps(results / f"results/depth{k:06d}.png") / 6553.5
            true = corridor_depth_m(c2w)
            near = true < 9.9  # what 16 bits hold
            assert np.abs(written - true)[near].max() < 1e-3
    assert f"0 frames rendered, {2 * FRAMES} kept" in said["generate hall/preset.yaml --out hall_out"]
    assert "scenes.0.corridor.width_m was 3, is 5; give it another name" in said["refused"]
    assert "scenes.0.corridor.widht_m: unknown key 'widht_m'; did you mean 'width_m'" in said["refused"]


def test_a_dataset_is_written_and_read_in_the_layout(worked):
    folder, said = worked
    images = sorted(file.name for file in (folder / "flat/clean/box").glob("*.png"))
    assert images == sorted(f"{k:06d}_{kind}.png" for k in range(FRAMES) for kind in ("rgb", "depth"))
    identity = json.loads((folder / "flat/manifest.json").read_text())["identity"]
    assert identity["versions"]["my-lab"] == "1.0"
    again = said["generate made/preset.yaml --out flat"]  # of the second time
    assert f"0 frames rendered, {FRAMES} kept" in again
    poses = np.loadtxt(folder / "tum/clean/flat/groundtruth.txt")
    assert np.abs(poses[:, 1:4] - path_poses(FRAMES)[:, :3, 3]).max() < 1e-5
    for k in range(FRAMES):  # 2,000 steps a metre become TUM's 5,000
        given = depth_steps(folder / f"flat/clean/box/{k:06d}_depth.png")
        assert given.max() > 1000
        assert np.abs(depth_steps(folder / f"tum/clean/flat/depth/{k:06d}.png") - 2.5 * given).max() <= 0.5


def test_a_recording_is_read_in_the_layout(worked):
    folder, _ = worked
    poses = np.loadtxt(folder / "tum/clean/phone/groundtruth.txt")
    assert np.allclose(poses[:, 0], np.arange(FRAMES) / 10)
    assert np.abs(poses[:, 1:4] - path_poses(FRAMES)[:, :3, 3]).max() < 1e-5
    for k in range(FRAMES):
        assert (depth_steps(folder / f"tum/clean/phone/depth/{k:06d}.png") == 5 * (2000 + 10 * k)).all()


def test_a_study_has_the_metric_and_the_system(worked):
    folder, _ = worked
    with (folder / "results/tables/runs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["system"], row["setting"]) for row in rows} == {("still", "clean"), ("still", "noise")}
    assert all(float(row["upward_max_m"]) > 0 for row in rows)
    assert "largest error upwards" in (folder / "results/report.md").read_text()


# --- the same as files of ours, in a copy of the project ---

STEPS = (ROOT / "docs/examples/my_noise/my_noise/stereo_steps.py").read_text(encoding="utf-8")
FILES = {
    "sources/corridor.py": CORRIDOR,
    "layouts/flat.py": FLAT,
    "layouts/phone.py": PHONE,
    "trajectories/odometer.py": ODOMETER,
    "channels/facing.py": FACING,
    "evaluate/upward.py": UPWARD,
    "evaluate/strays.py": STRAYS,
    "cli/holes.py": HOLES,
    "preset/helmet.py": HELMET,
    "perturbations/shipped/stereo_steps.py": STEPS,
    "evaluate/definitions/still.yaml": MODULES["systems/still.yaml"],
    "evaluate/definitions/still.py": STILL,
}
COMMANDS = """
import sys
from noisy_world.cli import command
for words in (
    *(["list", what] for what in ("layouts", "formats", "sources", "metrics", "cameras", "channels", "perturbations")),
    ["generate", "hall/preset.yaml", "--out", "hall_out"],
    ["generate", "made/preset.yaml", "--out", "flat"],
    ["evaluate", "flat", "--systems", "still", "--out", "results"],
    ["holes", "flat"],
):
    print(">", *words, flush=True)
    if command.main(words):
        sys.exit(f"{words} ended with an error")
"""


def with_own_imports(text):
    """A module that imports from where `noisy_world.extend` has its names, as modules of ours do."""
    ours = ast.parse((ROOT / "addon/noisy_world/extend.py").read_text(encoding="utf-8"))
    nodes = [node for node in ast.walk(ours) if isinstance(node, ast.ImportFrom)]
    homes = {item.name: node.module for node in nodes for item in node.names}

    def moved(match):
        names = [name.strip() for name in match[1].strip("()\n").split(",") if name.strip()]
        return "\n".join(f"from noisy_world.{homes[name]} import {name}" for name in names)

    return re.sub(r"from noisy_world\.extend import (\([^)]*\)|[^\n]*)", moved, text)


def linked(source, target):
    """Link a file, or copy it to another disk."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


@pytest.fixture(scope="module")
def copied(tmp_path_factory):
    """A copy of the project with a file of each kind more, what its commands said there, and their folder."""
    top, folder = tmp_path_factory.mktemp("copy"), tmp_path_factory.mktemp("work")
    shutil.copytree(ROOT / "addon", top / "addon", copy_function=linked)
    for name in ("docs", "presets", "headless/tools"):
        shutil.copytree(ROOT / name, top / name, ignore=shutil.ignore_patterns("*.jpg", "*.mp4", "*.png", "data"))
    for name in ("pyproject.toml", "blender_manifest.toml", "README.md", "CITATION.cff", "mkdocs.yml"):
        shutil.copy2(ROOT / name, top)
    for name, text in FILES.items():
        (top / "addon/noisy_world" / name).write_text(with_own_imports(text), encoding="utf-8")
    noise = [{"name": "clean"}, {"name": "steps", "perturb": [{"stereo_steps": {"severity": 4}}]}]
    output = {"layout": "flat", "modalities": ["rgb", "depth", "facing"], "depth_scale_per_m": 2000}
    write_world(folder / "made", frames=FRAMES, size=(32, 24), settings=noise, render=RENDER, output=output)
    hall = [{"name": "hall", "corridor": {"width_m": 3, "frames": 1}}]
    write_world(folder / "hall", size=(32, 24), scenes=hall, settings=noise[:1], render=RENDER)
    said = run_python(["-c", COMMANDS], top, folder)
    return top, folder, dict(re.findall(r"^> (.+)\n((?:(?!> ).*\n)*)", said, re.MULTILINE))


def run_python(arguments, top, folder):
    result = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(top / "addon")},
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_a_file_of_ours_is_enough(copied):
    _, folder, said = copied
    for words, name in (
        ("list layouts", "flat"),
        ("list layouts", "phone"),
        ("list formats", "odometer"),
        ("list sources", "corridor"),
        ("list metrics", "upward_max_m"),
        ("list metrics", "map.accuracy_max_m"),
        ("list cameras", "helmet"),
        ("list channels", "facing"),
        ("list perturbations", "stereo_steps"),
    ):
        line = re.search(rf"^ *{name} .*", said[words], re.MULTILINE)
        assert line, (words, name)
        assert "from my-lab" not in line[0]
    assert len(said["holes flat"].splitlines()) == 2
    assert sorted(file.name for file in (folder / "flat/steps/box/facing").iterdir())[0] == "000000.png"
    depths = [depth_steps(folder / f"flat/{setting}/box/000001_depth.png") for setting in ("clean", "steps")]
    assert len(np.unique(depths[1])) < len(np.unique(depths[0])) / 4
    with (folder / "results/tables/runs.csv").open(newline="") as file:
        assert all(float(row["upward_max_m"]) > 0 for row in csv.DictReader(file))


def test_the_pages_tell_of_it_when_they_are_made(copied):
    top, folder, _ = copied
    pages = {path: path.read_text(encoding="utf-8") for path in (top / "docs").glob("*.md")}
    run_python([str(top / "headless/tools/pages.py")], top, folder)
    run_python([str(top / "headless/tools/pages.py"), "--check"], top, folder)
    added = {path.name: told for path, text in pages.items() if (told := added_lines(text, path.read_text("utf-8")))}
    for page, name in TOLD:
        assert f"`{name}`" in added[page], (page, name)
    preset = read_preset(top / "presets/perturbations/stereo_steps.yaml")
    assert preset.spec.settings[1].sweep.perturb == ("stereo_steps",)


TOLD = (
    *(("perturbations.md", "stereo_steps"), ("gallery.md", "stereo_steps"), ("channels.md", "facing")),
    *(("layouts.md", "flat"), ("trajectories.md", "odometer"), ("generate.md", "corridor"), ("camera.md", "helmet")),
    *(("metrics.md", "upward_max_m"), ("metrics.md", "accuracy_max_m"), ("systems.md", "still")),
)


def added_lines(before, after):
    """The lines that a text has more than it had."""
    known = set(before.splitlines())
    return "\n".join(line for line in after.splitlines() if line not in known)


# --- what is wrong ---

NAMELESS = FLAT.replace('name = "flat"', 'name = "Flat one"')
WITHOUT = FLAT.replace("depth_scale_per_m = 1000.0", "").replace('label = "Flat"', "")
UNMADE = FLAT.replace("LAYOUT = FlatLayout()", "LAYOUT = FlatLayout")
IN_USE = FLAT.replace('name = "flat"', 'name = "tum"')


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (NAMELESS, "'Flat one' is no name of a layout: small letters, digits and underscores, a letter first"),
        (WITHOUT, "its layout FlatLayout lacks label, depth_scale_per_m"),
        (UNMADE, "is a class; give an object of it: LAYOUT = FlatLayout()"),
        (IN_USE, "its layout tum has the name of one of our own; rename it, or uninstall the package"),
        ("LAYOUT = 1", "is a int, but has to be one of Layout, RecordedLayout, or a package of modules"),
    ],
)
def test_a_broken_layout_is_one_line(monkeypatch, tmp_path, text, told):
    modules = {"__init__.py": "", "flat.py": text}
    installed_package.install(tmp_path, "broken-lab", "0.1", {"x": "broken_lab.flat:LAYOUT"}, modules, kind="layouts")
    monkeypatch.syspath_prepend(str(tmp_path))
    EVERY.forget()
    try:
        with pytest.raises(NoisyWorldError) as raised:
            list(EVERY)
    finally:
        monkeypatch.undo()
        EVERY.forget()
        for name in [item for item in sys.modules if item.partition(".")[0] == "broken_lab"]:
            del sys.modules[name]
    assert str(raised.value).startswith("broken-lab 0.1: ")
    assert told in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_dataset_whose_layout_is_not_installed_says_so(worked):
    folder, _ = worked
    identity = json.loads((folder / "flat/manifest.json").read_text())["identity"]
    assert identity_problem(identity) == (
        "is in the layout 'flat', which is not known here: install the package that brings it"
    )
    # The command, without the package: one line, and what is there stays.
    result = generate(folder / "made/preset.yaml", "--set", "output.layout=tum", "--out", folder / "flat", check=False)
    assert result.returncode == 1
    assert "Traceback" not in result.stderr
    assert len(list((folder / "flat/clean/box").glob("*.png"))) == 2 * FRAMES
    assert "'flat', which is not known here: install the package that brings it" in result.stderr
