# SPDX-License-Identifier: GPL-3.0-or-later
"""Perturbations of installed packages: one of each kind acts in the generator, the list and the library."""

import json
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
import installed_package
from analytic import box_depth
from worlds import HIGH, LOW, ROOT, generate, generate_here, need_blender, path_poses, write_world

from noisy_world.cli import command
from noisy_world.core.errors import NoisyWorldError
from noisy_world.core.geometry import Intrinsics
from noisy_world.core.streams import stream
from noisy_world.perturb import apply, frames
from noisy_world.perturbations import registry

COUNT = 6
SIZE = (64, 48)
CAMERA = Intrinsics(*SIZE, 32.0, 32.0, 31.5, 23.5)
SCALE = 6553.5  # Replica's, in steps of depth for a metre
LIFTED_M, SHIVER_M = 0.25, 0.02
ROUNDED = 2e-9  # of what a path is rounded to: a nanometre, and 2e-9 rad
SETTINGS = [
    {"name": "clean"},
    {"name": "lifted", "perturb": [{"lift": {"height_m": LIFTED_M, "shiver_m": SHIVER_M}}]},
    {"name": "stuttering", "perturb": [{"stutter": {"times": 3}}, {"gaussian_noise": {"severity": 1}}]},
    {"name": "warm", "perturb": [{"warm": {"severity": 4}}]},
    {"name": "grazing", "perturb": [{"grazing": None}]},
    {"name": "backwards", "perturb": [{"backwards": {"skip_last": True}}]},
    {
        "name": "together",
        "perturb": [
            {"backwards": None},
            {"grazing": None},
            {"stutter": None},
            {"faster_motion": {"factor": 2}},
            {"lift": {"severity": 3}},
        ],
    },
]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return installed_package.install(tmp_path_factory.mktemp("site"))


@pytest.fixture
def installed(monkeypatch):
    """Install into this process: a function that takes folders and returns the registry as it is with them."""

    def install(*folders):
        for folder in folders:
            monkeypatch.syspath_prepend(str(folder))
        registry.cache_clear()
        return registry()

    yield install
    registry.cache_clear()
    for name in [item for item in sys.modules if item.partition(".")[0] in ("studio_effects", "working_effects")]:
        del sys.modules[name]


def with_site(site):
    return os.environ | {"PYTHONPATH": str(site)}


@pytest.fixture(scope="module")
def out(site, tmp_path_factory):
    need_blender()
    world = tmp_path_factory.mktemp("world")
    preset = write_world(world, frames=COUNT, size=SIZE, settings=SETTINGS)
    generate(preset, "--out", world / "out", env=with_site(site))
    return world / "out"


def image(out, setting, kind, frame):
    suffix = "png"
    path = out / setting / "box" / "results" / f"{kind}{frame:06d}.{suffix}"
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None, path
    return found[..., ::-1] if found.ndim == 3 else found


def poses(out, setting, name="traj.txt"):
    return np.loadtxt(out / setting / "box" / name).reshape(-1, 4, 4)


def records(out, setting):
    return [json.loads(line) for line in (out / setting / "box" / "frames.jsonl").read_text().splitlines()]


# --- the generator ---


def lifted(setting, height_m, shiver_m):
    """The poses that the motion makes, from the published streams."""
    moved = path_poses(COUNT)
    moved[:, 2, 3] += height_m
    for k, pose in enumerate(moved):
        pose[0, 3] += shiver_m * stream(3, "box", setting, "lift", 0, frame=k).standard_normal()
    return moved


def test_motion_that_moves_is_rendered_from_there(out):
    moved = lifted("lifted", LIFTED_M, SHIVER_M)
    assert np.abs(poses(out, "lifted") - moved).max() < ROUNDED
    assert np.abs(poses(out, "lifted", "traj_nominal.txt") - path_poses(COUNT)).max() < ROUNDED
    for k in range(COUNT):
        depth_m, sure = box_depth(CAMERA, moved[k], LOW, HIGH)
        assert np.abs(image(out, "lifted", "depth", k) / SCALE - depth_m)[sure].max() < 2 / SCALE
    assert not np.array_equal(image(out, "lifted", "frame", 0), image(out, "clean", "frame", 0))


def test_motion_that_chooses_shows_frames_again(out):
    shown = [0, 0, 0, 3, 3, 3]
    assert np.array_equal(poses(out, "stuttering"), poses(out, "clean")[shown])
    assert [record["time_s"] for record in records(out, "stuttering")] == [
        record["time_s"] for record in records(out, "clean")
    ]
    for frame, source in enumerate(shown):
        assert np.array_equal(image(out, "stuttering", "depth", frame), image(out, "clean", "depth", source))
    # The same picture, but each frame has a noise of its own.
    first, second = (image(out, "stuttering", "frame", k).astype(float) for k in (3, 4))
    assert 1 < np.abs(first - second).mean() < 30
    assert np.abs(first - image(out, "clean", "frame", 3)).mean() < 20


def test_colour_acts(out):
    clean, warm = (image(out, name, "frame", 2).astype(float) for name in ("clean", "warm"))
    assert np.array_equal(warm[..., 1:], clean[..., 1:])
    assert np.abs(warm[..., 0] - np.minimum(clean[..., 0] * 1.4, 255)).max() <= 1.2  # both are rounded


def grazing(depth_m, rgb, stamp_s, setting, frame):
    """Float64: along the ray, and what is added for time, darkness and chance."""
    height, width = depth_m.shape
    v, u = np.mgrid[:height, :width]
    rays = np.sqrt(1 + ((u - 31.5) / 32) ** 2 + ((v - 23.5) / 32) ** 2)
    jitter_m = 0.05 * stream(3, "box", setting, "grazing", 0, "jitter", frame=frame).random()
    return depth_m * rays + 0.5 * stamp_s + 0.2 * (1 - rgb.mean(axis=-1) / 255) + jitter_m


def test_depth_is_told_what_a_sensor_knows(out):
    stamps_s = [record["time_s"] for record in records(out, "clean")]
    assert stamps_s[-1] > 0
    for k in range(COUNT):
        clean_m = image(out, "clean", "depth", k) / SCALE
        expected_m = grazing(clean_m, image(out, "clean", "frame", k), stamps_s[k], "grazing", k)
        # Clean depth and colour are read rounded: half a step along the ray, half a level of 0.2 m.
        assert np.abs(image(out, "grazing", "depth", k) / SCALE - expected_m).max() < 2 / SCALE + 0.2 / 510
        assert np.array_equal(image(out, "grazing", "frame", k), image(out, "clean", "frame", k))


def test_pairing_acts(out):
    for k in range(COUNT - 1):
        assert np.array_equal(image(out, "backwards", "depth", k), image(out, "clean", "depth", COUNT - 1 - k))
        assert np.array_equal(image(out, "backwards", "frame", k), image(out, "clean", "frame", k))
    said = [record["perturbed"]["pairing"]["depth_of_frame"] for record in records(out, "backwards")]
    assert said == [5, 4, 3, 2, 1]


def test_all_of_them_act_in_their_order(out):
    # Lifted; every second pose: 0, 2, 4; each of these shown twice, the third lost to the length: 0, 0, 4 of 0, 2, 4.
    moved = lifted("together", 0.3, 0.0)[[0, 0, 4]]
    assert np.abs(poses(out, "together") - moved).max() < ROUNDED
    for frame, taken in enumerate([2, 1, 0]):
        depth_m, sure = box_depth(CAMERA, moved[taken], LOW, HIGH)
        rgb = image(out, "together", "frame", [2, 0, 0][frame])
        expected_m = grazing(depth_m, rgb, 0.05 * taken, "together", taken)
        assert np.abs(image(out, "together", "depth", frame) / SCALE - expected_m)[sure].max() < 2 / SCALE + 0.2 / 510


def test_the_dataset_names_the_package_that_it_is_made_with(out, installed, site, tmp_path):
    installed(site)
    versions = json.loads((out / "manifest.json").read_text())["identity"]["versions"]
    assert versions["studio-effects"] == "2.1"
    scenes = [{"name": "box", "sequence": str(out / "clean" / "box")}]
    preset = write_world(tmp_path / "a", size=SIZE, scenes=scenes, settings=[{"name": "s", "perturb": [{"fog": None}]}])
    generate_here(preset, "--out", tmp_path / "b")
    versions = json.loads((tmp_path / "b" / "manifest.json").read_text())["identity"]["versions"]
    assert "studio-effects" not in versions


def test_a_recording_is_perturbed_but_not_seen_from_elsewhere(out, installed, site, tmp_path):
    installed(site)
    scenes = [{"name": "box", "sequence": str(out / "clean" / "box")}]
    given = [item for item in SETTINGS if item["name"] not in ("lifted", "together")]
    preset = write_world(tmp_path / "a", size=SIZE, scenes=scenes, settings=given)
    generate_here(preset, "--out", tmp_path / "again")
    for name in ("stuttering", "backwards", "warm"):
        for kind, frame in (("frame", 3), ("depth", 3)):
            first, second = (image(folder, name, kind, frame).astype(float) for folder in (out, tmp_path / "again"))
            assert np.abs(first - second).max() <= (2 if kind == "frame" else 0)
    stored_m = image(out, "clean", "depth", 3) / SCALE
    stamp_s = records(tmp_path / "again", "grazing")[3]["time_s"]
    expected_m = grazing(stored_m, image(out, "clean", "frame", 3), stamp_s, "grazing", 3)
    assert np.abs(image(tmp_path / "again", "grazing", "depth", 3) / SCALE - expected_m).max() < 0.51 / SCALE
    preset = write_world(tmp_path / "c", size=SIZE, scenes=scenes, settings=[SETTINGS[1]])
    result = generate_here(preset, "--out", tmp_path / "d", check=False)
    assert result.returncode == 1
    assert "cannot be seen from elsewhere" in result.stderr


def test_colour_is_rendered_for_depth_that_needs_it_and_only_from_the_same_place(out, installed, site, tmp_path):
    given = {"size": SIZE, "frames": COUNT, "settings": [SETTINGS[4]]}
    output = {"layout": "replica", "image": "png", "modalities": ["depth"]}
    preset = write_world(tmp_path / "a", output=output, **given)
    generate(preset, "--out", tmp_path / "b", "--frames", "2:3", env=with_site(site))
    assert np.array_equal(image(tmp_path / "b", "grazing", "depth", 2), image(out, "grazing", "depth", 2))
    assert not list((tmp_path / "b").rglob("frame0*"))
    rig = {"rgb": {"translation_m": [0.1, 0, 0]}, "depth": {"translation_m": [0.2, 0, 0]}}
    scenes = [{"name": "box", "mesh": "mesh.ply", "trajectory": {"file": "traj.txt", "axes": "robot"}}]
    preset = write_world(tmp_path / "c", rig=rig, scenes=scenes, **given)
    installed(site)
    result = generate_here(preset, "--dry-run", check=False)
    assert result.returncode == 1
    assert "grazing: needs the colour that the depth sensor sees, but rig.depth has another pose" in result.stderr


def test_the_list_tells_kind_stage_order_and_where_it_is_from(installed, site, capsys):
    installed(site)
    lines = generate_here("--list", "perturbations").stdout.splitlines()
    names = [line.split()[0] for line in lines]
    own = names.index("motion_deviation")
    assert names[own : own + 4] == ["motion_deviation", "lift", "faster_motion", "stutter"]
    assert names[-3:] == ["depth_range_clipping", "desync", "backwards"]
    assert command.main(["list", "perturbations", "lift", "warm"]) == 0
    told = capsys.readouterr().out.splitlines()
    heads = [line for line in told if not line.startswith(" ")]
    assert [line.split("; ")[-1] for line in heads] == ["from studio-effects 2.1"] * 2
    assert {"    motion, stage motion, order 15", "    colour, stage lens, order 5"} <= set(told)
    assert any("height_m" in line and "severities 1 to 5: 0.1, 0.2, 0.3, 0.4, 0.5" in line for line in told)


def test_no_group_means_the_reference(installed, tmp_path):
    modules = dict(installed_package.MODULES)
    modules["effects/warm.py"] = modules["effects/warm.py"].replace("apply=apply, build=build", "apply=apply")
    folder = installed_package.install(tmp_path / "site", modules=modules)
    given = {"settings": [SETTINGS[3]], "render": {"backend": "compositor"}}
    installed(folder)
    result = generate_here(write_world(tmp_path / "a", **given), "--dry-run", check=False)
    assert result.returncode == 1
    assert "warm: warm has no node group for the compositor; give it backend: reference" in result.stderr


# --- the library ---


def test_the_library_has_them(installed, site, out):
    known = installed(site)
    assert {known[name].distribution.name for name in ("lift", "stutter", "warm", "grazing", "backwards")} == {
        "studio-effects"
    }
    rgb, depth_m = np.full((48, 64, 3), 0.5, np.float32), np.full((48, 64), 2, np.float32)
    assert np.allclose(apply(rgb, "warm", gain=1.5)[0, 0], [0.75, 0.5, 0.5])
    made = apply(depth_m, "grazing", seed=3, frame=4, rgb=rgb, intrinsics=CAMERA, stamp_s=2.0, jitter_m=0.0)
    assert made[23, 31] == pytest.approx(2 * np.sqrt(1 + 2 * (0.5 / 32) ** 2) + 1.0 + 0.1, abs=1e-6)
    with pytest.raises(TypeError, match="grazing needs the frame's colour"):
        apply(depth_m, "grazing")
    for name in ("lift", "stutter", "backwards"):
        with pytest.raises(TypeError, match="acts on a whole sequence"):
            apply(rgb, name)
    asked = [{"stutter": {"times": 3}}, {"backwards": None}, {"warm": {"severity": 4}}]
    items = list(frames(out / "clean" / "box", asked, seed=3, setting="s", scene="box"))
    assert len(items) == COUNT
    for item in items:
        shown, paired = (0, 0, 0, 3, 3, 3)[item.index], (3, 3, 3, 0, 0, 0)[item.index]
        assert np.array_equal(item.depth_m, np.float32(image(out, "clean", "depth", paired) / SCALE))
        assert np.array_equal(item.rgb[..., 1:], image(out, "clean", "frame", shown)[..., 1:])
        assert np.array_equal(item.c2w, poses(out, "clean")[shown])
    with pytest.raises(NoisyWorldError, match="lift needs a mesh"):
        next(frames(out / "clean" / "box", [{"lift": None}]))


def test_in_the_extension_they_lead_to_the_modules_that_blender_loaded(site, tmp_path):
    repository = tmp_path / "bl_ext" / "user_default"
    repository.mkdir(parents=True)
    (repository / "noisy_world").symlink_to(ROOT / "addon" / "noisy_world")
    code = """
import sys
from bl_ext.user_default.noisy_world.perturbations import kinds
from bl_ext.user_default.noisy_world.other_name import take_other_names
from bl_ext.user_default.noisy_world.perturbations import registry
assert isinstance(registry()["lift"], kinds.MotionPerturbation)
import noisy_world.extend
assert noisy_world.extend.MotionPerturbation is kinds.MotionPerturbation
assert noisy_world.perturbations.kinds is kinds
take_other_names()
assert not [name for name in sys.modules if name.partition(".")[0] == "noisy_world"]
assert kinds.__name__ == "bl_ext.user_default.noisy_world.perturbations.kinds"
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(site), str(tmp_path)])}
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=tmp_path, check=False
    )
    assert result.returncode == 0, result.stderr


# --- what is wrong with a package is said in a line ---

BODY = """
from dataclasses import dataclass
from noisy_world.extend import PairingPerturbation, key

@dataclass(frozen=True)
class Nothing:
    amount: int = key("nothing", default=1)

PERTURBATION = PairingPerturbation(
    name="{name}", label="X", order=1, parameters=Nothing, severities={{}}, source="none", apply=lambda *_: None
)
"""


@pytest.mark.parametrize(
    "case",
    [
        (
            BODY.format(name="desync"),
            "working_effects.x:PERTURBATION",
            "its perturbation desync has the name of one of our",
        ),
        (
            BODY.format(name="lift"),
            "working_effects.x:PERTURBATION",
            "its perturbation lift has the name of one of studio-",
        ),
        (BODY.format(name="other"), "working_effects.x:apply", "cannot be loaded: AttributeError: module"),
        (
            BODY.format(name="other"),
            "working_effects.y:PERTURBATION",
            "cannot be loaded: ModuleNotFoundError: No module",
        ),
        (BODY.format(name="other"), "working_effects.x:Nothing", "is a type, but has to be one of MotionPerturbation"),
        (BODY.format(name="other"), "working_effects.x", "is a module, but has to be one of MotionPerturbation"),
        (
            BODY.format(name="Other"),
            "working_effects",
            "the module working_effects.x cannot be loaded: ValueError: 'Other'",
        ),
        ("import a_package_that_is_not_there", "working_effects", "cannot be loaded: ModuleNotFoundError: No module"),
        ("raise RuntimeError('two\\nlines')", "working_effects", "cannot be loaded: RuntimeError: two lines; mend"),
        ("HELPERS = 1", "working_effects", "the module working_effects.x holds no PERTURBATION; begin the names"),
        (
            "class PairingPerturbation: pass\nPERTURBATION = PairingPerturbation()",
            "working_effects",
            "was made with another copy of noisy_world; restart",
        ),
    ],
)
def test_what_cannot_be_had_names_the_package(installed, site, tmp_path, case):
    module, entry, told = case
    modules = {"__init__.py": "", "x.py": module}
    other = installed_package.install(tmp_path, "working-effects", "0.3", {"x": entry}, modules)
    with pytest.raises(NoisyWorldError) as raised:
        installed(site, other)
    assert told in str(raised.value)
    assert str(raised.value).startswith("working-effects 0.3: ")
    assert "\n" not in str(raised.value)


def test_the_command_line_says_it_without_a_traceback(tmp_path):
    modules = {"__init__.py": "raise RuntimeError('no')"}
    other = installed_package.install(tmp_path, "working-effects", "0.3", {"x": "working_effects"}, modules)
    result = generate("--list", "perturbations", env=with_site(other), check=False)
    assert result.returncode == 1
    told = "the entry point x = working_effects cannot be loaded: RuntimeError: no; mend or uninstall the package"
    assert result.stderr.strip().splitlines()[-1].endswith(f"working-effects 0.3: {told}")
    assert "Traceback" not in result.stderr


def test_a_motion_that_breaks_its_contract_ends_the_run_in_a_line(installed, tmp_path):
    pytest.importorskip("embreex", reason="embreex comes with an extra")
    modules = dict(installed_package.MODULES)
    for name, line in (("lift", "c2w[1:], trajectory.stamps_s[1:]"), ("stutter", "")):
        text = modules[f"effects/{name}.py"]
        old, new = ("c2w, trajectory.stamps_s)", f"{line})") if line else ("// parameters", "+ parameters")
        modules[f"effects/{name}.py"] = text.replace(old, new)
    installed(installed_package.install(tmp_path / "site", modules=modules))
    for name, told in (
        ("lift", "lift: made 5 poses of 6, or other time stamps"),
        ("stutter", "stutter: choose has to return 1 to 6 whole numbers from 0 to 5"),
    ):
        settings, render = [{"name": "s", "perturb": [{name: None}]}], {"engine": "embree", "backend": "reference"}
        preset = write_world(tmp_path / name, settings=settings, render=render)
        result = generate_here(preset, "--out", tmp_path / name / "out", check=False)
        assert result.returncode == 1
        assert told in result.stderr.strip().splitlines()[-1]
        assert "Traceback" not in result.stderr
