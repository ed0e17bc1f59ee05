# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets: what they may say, and what is said of those that are wrong."""

import pytest
from refusals import refused
import yaml
from cases import cases
from worlds import write_box_ply, write_world

from noisy_world.dataset.plan import make_plan
from noisy_world.preset.keys import read_preset
from noisy_world.sources import preset_keys, read_scenes

MINIMAL = "scenes: [{mesh: a.ply, trajectory: b.txt}]\n"


def perturbed(text, *, bare=False):
    inside = f"{{{text}}}" if bare else f"[{{{text}}}]"
    return MINIMAL + f"settings: [{{name: a, perturb: {inside}}}]\n"


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "preset.yaml"
        path.write_text(text)
        return path

    return write


def test_defaults(write):
    preset = read_preset(write(MINIMAL))
    spec = preset.spec
    assert (spec.seed, spec.render.engine, spec.render.samples) == (0, "cycles", 1)
    assert [setting.name for setting in spec.settings] == ["clean"]
    assert (spec.mesh_camera.width, spec.mesh_camera.height, spec.mesh_camera.cx) == (1200, 680, 599.5)
    (scene,) = read_scenes(preset)
    assert (scene.kind.name, scene.keys.trajectory.file) == ("mesh", "b.txt")


@cases(
    ("text", "words"),
    [
        ("sceens: []\n", ["sceens", "unknown key", "did you mean 'scenes'"]),
        (MINIMAL + "render: {sampels: 2}\n", ["render.sampels", "did you mean 'samples'"]),
        (MINIMAL + "render: {engine: cycels}\n", ["render.engine", "did you mean 'cycles'"]),
        (MINIMAL + "render: {samples: 2.5}\n", ["render.samples", "the number 2.5", "whole number"]),
        (MINIMAL + "render: {samples: true}\n", ["render.samples", "the truth value true"]),
        (MINIMAL + "render: {samples: -1}\n", ["render.samples", "out of range", "1 to 65536"]),
        (MINIMAL + "render: [1]\n", ["render", "a list", "mapping of engine, backend, device, "]),
        (MINIMAL + "seed: -1\n", ["seed", "out of range"]),
        (MINIMAL + "seed: .nan\n", ["seed", "whole number"]),
        (MINIMAL + "camera: {width: 10}\n", ["camera.height", "is missing"]),
        (MINIMAL + "camera: {width: 8, height: 8, fx: .inf, fy: 1, cx: 1, cy: 1}\n", ["camera.fx", "finite"]),
        (MINIMAL + "camera: {width: 8, height: 8, fx: 0, fy: 1, cx: 1, cy: 1}\n", ["camera.fx", "above 0"]),
        (MINIMAL + "settings: []\n", ["settings", "is empty"]),
        (MINIMAL + "settings: [{name: a}, {name: a}]\n", ["settings.1.name", "given twice"]),
        (MINIMAL + "settings: [{name: A}, {name: a}]\n", ["settings.1.name", "'A'", "'a'", "case"]),
        (MINIMAL + "settings: [{name: ../up}]\n", ["settings.0.name", "'../up'"]),
        (MINIMAL + "settings: [{name: off}]\n", ["settings.0.name", "the truth value false", "quotes"]),
        (MINIMAL + "output: {layout: tum, image: jpg}\n", ["output.image", "use png"]),
        (MINIMAL + "output: {layout: replika}\n", ["output.layout", "did you mean 'replica'"]),
        (MINIMAL + "rig: {rgb: {quat_wxyz: [1, 0, 0]}}\n", ["rig.rgb.quat_wxyz", "3 entries", "4"]),
        (
            MINIMAL + "rig: {rgb: {quat_wxyz: [1, 0, 0, 0], rotation_euler_deg: [0, 0, 0]}}\n",
            ["rig.rgb", "more than one rotation"],
        ),
        (MINIMAL + "output: {modalities: []}\n", ["output.modalities", "each once: rgb, depth"]),
        (MINIMAL + "output: {modalities: [rgb, rgb]}\n", ["output.modalities", "each once"]),
        (MINIMAL + "output: {modalities: [rgbd]}\n", ["output.modalities.0", "did you mean 'rgb'"]),
        (MINIMAL + "output: {modalities: rgb}\n", ["output.modalities", "a list"]),
        (MINIMAL + "render: {engine: eevee, device: gpu}\n", ["render.device", "eevee renders with GL"]),
        (MINIMAL + "render: {device: cuda}\n", ["render.device", "unknown value 'cuda'"]),
        (MINIMAL + "render: {engine: workbench, samples: 4}\n", ["render.samples", "Workbench knows 1, 5, 8"]),
        ("scenes: [{mesh: a.ply, trajectory: {}}]\n", ["scenes.0.trajectory", "either file or handheld"]),
        ("scenes: [{mesh: a.ply, trajectory: {file: b, stop: 1, start: 4}}]\n", ["trajectory.stop", "beyond start"]),
        ("scenes: [{mesh: a.ply}]\n", ["scenes.0.trajectory", "is missing"]),
        ("scenes: []\n", ["scenes", "is empty"]),
        ("", ["is empty"]),
        ("- 1\n", ["not a mapping"]),
        ("seed: 1\nseed: 2\n", ["line 2", "'seed' is given twice"]),
        ("seed: [1\n", ["line 2", "YAML"]),
        ("seed: !!python/object/apply:os.system ['true']\n" + MINIMAL, ["line 1", "YAML"]),
        ("a: \x07\n", ["YAML"]),
        (MINIMAL + "1: 2\n", ["line 2, column 1", "a key is the number 1"]),
        ("scenes: [{trajectory: b.txt}]\n", ["scenes.0: needs one of mesh, replica, sequence, video, blend"]),
        ("scenes: [{sequence: a, trajectory: b.txt}]\n", ["scenes.0.trajectory", "goes with mesh"]),
        (MINIMAL + "settings: [{}]\n", ["settings.0", "either name or sweep"]),
        (perturbed("fog: {severity: 3}", bare=True), ["settings.0.perturb", "has to be a list"]),
        (perturbed("fogg: {severity: 3}"), ["settings.0.perturb.0", "unknown perturbation 'fogg'", "'fog'"]),
        (perturbed("fog: {severty: 3}"), ["settings.0.perturb.0.fog.severty", "did you mean 'severity'"]),
        (perturbed("fog: {severity: 0.5}"), ["settings.0.perturb.0.fog.severity", "0.5", "0, or 1 to 5"]),
        (perturbed("fog: {severity: 6}"), ["settings.0.perturb.0.fog.severity", "out of range"]),
        (perturbed("fog: {severity: true}"), ["settings.0.perturb.0.fog.severity", "truth value"]),
        (perturbed("fog: 3"), ["settings.0.perturb.0.fog", "has to be a mapping"]),
        (perturbed("fog: {mode: wild}"), ["settings.0.perturb.0.fog.mode", "static, dynamic or keyed"]),
        (perturbed("fog: {severity: 2.5, mode: dynamic}"), ["settings.0.perturb.0.fog.severity", "whole"]),
        (perturbed("fog: {levels: [1, 2]}"), ["settings.0.perturb.0.fog.levels", "mode: dynamic"]),
        (perturbed("fog: {mode: dynamic, levels: [1, 9]}"), ["settings.0.perturb.0.fog.levels.1", "out of range"]),
        (perturbed("fog: {mode: dynamic, levels: []}"), ["settings.0.perturb.0.fog.levels", "list of severities"]),
        (perturbed("fog: {temporal: never}"), ["settings.0.perturb.0.fog.temporal", "one of fresh"]),
        (perturbed("gaussian_noise: {std: -1}"), ["settings.0.perturb.0.gaussian_noise.std", "out of range"]),
        (perturbed("gaussian_noise: {std: loud}"), ["settings.0.perturb.0.gaussian_noise.std", "a number"]),
        (perturbed("desync: {severity: 3}"), ["settings.0.perturb.0.desync.severity", "unknown key"]),
        (perturbed("desync: {offset: 1}}, {desync: {offset: 2}"), ["settings.0.perturb.1", "given twice"]),
        (MINIMAL + "settings: [{sweep: {perturb: [fig]}}]\n", ["settings.0.sweep.perturb.0", "did you mean 'fog'"]),
        (MINIMAL + "settings: [{sweep: {perturb: [desync]}}]\n", ["settings.0.sweep.perturb.0", "no severities"]),
        (MINIMAL + "settings: [{sweep: {perturb: [fog], modes: [x]}}]\n", ["settings.0.sweep.modes.0", "'x'"]),
        (MINIMAL + "seed: 1" + "0" * 400, ["seed", "2^1328 or more", "finite"]),
        (MINIMAL + f"camera: {{width: 8, height: 8, fx: {'9' * 400}, fy: 1, cx: 1, cy: 1}}\n", ["camera.fx", "finite"]),
        (MINIMAL + "camera: {width: 8, height: 8, fx: -1e999, fy: 1, cx: 1, cy: 1}\n", ["camera.fx", "-inf", "finite"]),
        (perturbed(f"fog: {{severity: {'9' * 400}}}"), ["fog.severity", "out of range"]),
        (perturbed(f"fog: {{thickness: {'9' * 400}}}"), ["fog.thickness", "finite"]),
        (MINIMAL + f"settings: [{{name: {'a' * 300}}}]\n", ["settings.0.name", "300 characters", "at most 200"]),
        (MINIMAL + '"a\\nb\\e[31m": 1\n', [r"'a\nb\x1b[31m': unknown key"]),
        (MINIMAL + f"? {'k' * 5000}\n: 1\n", ["unknown key", "(5000 characters)"]),
        (
            MINIMAL + f"settings: [{{sweep: {{perturb: [{'fog, ' * 3000}], severities: [{'1, ' * 3000}]}}}}]\n",
            ["settings.0", "makes 9000000 settings", "at most 10000"],
        ),
        (
            MINIMAL
            + "settings: ["
            + f"{{sweep: {{perturb: [fog, snow], severities: [{'1, ' * 3000}]}}}}, " * 2
            + "]\n",
            ["settings.1", "makes 12000 settings with those before it"],
        ),
    ],
)
def test_mistakes_name_file_and_key(write, text, words):
    path = write(text)
    message = refused(lambda: make_plan(read_preset(path)), names=words)
    assert message.startswith(str(path))
    assert len(message) < 600


def test_missing_preset_lists_those_there(write):
    path = write(MINIMAL)
    refused(read_preset, path.with_name("presett.yaml"), names=("presett.yaml: ", "presets there: preset.yaml"))


def test_overrides(write):
    path = write(MINIMAL)
    preset = read_preset(
        path, ["render.samples=16", "scenes.0.name=kitchen", "scenes.0.trajectory.every=3", "camera.far_m=1e1",
               "camera.width=4", "camera.height=4", "camera.fx=1", "camera.fy=1", "camera.cx=1", "camera.cy=1"]
    )  # fmt: skip
    (scene,) = read_scenes(preset)
    assert (preset.spec.render.samples, scene.keys.name, preset.spec.camera.far_m) == (16, "kitchen", 10.0)
    assert (scene.keys.trajectory.file, scene.keys.trajectory.every) == ("b.txt", 3)
    for bad, word in (
        (["seed"], "key.path=value"),
        (["=1"], "key.path=value"),
        (["seed.x=1"], "seed"),
        (["a=[1"], "--set a=[1: line 1, column 3: is not valid YAML"),
        (["seed=!!int x"], ("--set seed=!!int x: line 1, column 1: ", "'x'")),
        (["seed=0b_"], "no whole number"),
        (["seed=" + "9" * 5000], ("--set 'seed=9", "... (5005 characters): line 1")),
        (["seed=1" + "0" * 400], ("seed: is 2^1328 or more", "finite")),
        (["seed=1e999"], ("seed: ", "inf")),
        (["a={[b]: c}"], "a key is a list"),
        (["a=" + "[" * 5000], "nested more than 32 deep"),
        (["a=" + "0\n" * 300_000], "is larger than 512 KiB"),
        (["a=&b [*b]"], "stands inside what it names"),
        (["a" + ".a" * 5000 + "=1"], "leads more than 32 deep"),
        ([f"scenes.{'9' * 5000}=1"], "is no entry of this list"),
        (["scenes.\u0663=1"], "is no entry of this list"),
        (["a\nb=1"], r"'a\nb': unknown key"),
    ):
        assert len(refused(read_preset, path, bad, names=word)) < 500


def test_an_alias_that_is_set_changes_alone(write):
    text = "settings: [{name: a, perturb: &p [{fog: {severity: 3}}]}, {name: b, perturb: *p}]\n"
    preset = read_preset(write(MINIMAL + text), ["settings.1.perturb.0.fog.severity=5"])
    assert [item.perturb[0]["fog"]["severity"] for item in preset.spec.settings] == [3, 5]


def test_the_hash_is_of_the_content(write):
    first = read_preset(write("seed: 1  # a comment\n" + MINIMAL)).sha256
    assert read_preset(write(MINIMAL + "seed: 1\n")).sha256 == first
    assert read_preset(write(MINIMAL + "seed: 2\n")).sha256 != first
    assert read_preset(write(MINIMAL + "seed: 2\n"), ["seed=1"]).sha256 == first


def test_globs_make_scenes(tmp_path):
    world = write_world(tmp_path / "world", frames=3)
    for name in ("office0", "office1", "room0"):
        (tmp_path / name).mkdir()
        write_box_ply(tmp_path / name / f"{name}_mesh.ply")
        (tmp_path / name / "traj.txt").write_text((world.parent / "traj.txt").read_text())
    preset = tmp_path / "glob.yaml"
    scene = {"name": "*", "mesh": "office*/office*_mesh.ply", "trajectory": "office*/traj.txt"}
    preset.write_text(yaml.safe_dump({"scenes": [scene]}))
    plan = make_plan(read_preset(preset, ["scenes.0.name=office*"]))
    assert [render.scene.name for render in plan.renders] == ["office0", "office1"]
    paths = [str(render.scene.source.path_file.relative_to(tmp_path)) for render in plan.renders]
    assert paths == ["office0/traj.txt", "office1/traj.txt"]
    refused(
        lambda: make_plan(read_preset(preset, ["scenes.0.mesh=nothing/*.ply"])), names="scenes.0.mesh: no file matches"
    )
    refused(
        lambda: make_plan(read_preset(preset, ["scenes.0.name=one"])),
        names=("scenes.0.name: ", "'one'", "2 meshes"),
    )


@cases(
    ("override", "words"),
    [
        ("scenes.0.trajectory=none.txt", "scenes.0.trajectory: no such file"),
        ("scenes.0.mesh=embedded:roon", ("scenes.0.mesh: ", "'embedded:roon'", "did you mean")),
        ("scenes.0.trajectory.start=99", ("scenes.0.trajectory: ", "of 6")),
        ("rig={rgb: {matrix: [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}", "rig.rgb: "),
        (
            "scenes=[{mesh: mesh.ply, trajectory: traj.txt}, {mesh: mesh.ply, trajectory: traj.txt}]",
            r"names two scenes",
        ),
    ],
)
def test_what_a_plan_refuses(tmp_path, override, words):
    preset = write_world(tmp_path)
    refused(lambda: make_plan(read_preset(preset, [override])), names=words)


def test_resampling_and_subsampling_count_frames(tmp_path):
    preset = write_world(tmp_path, frames=6)  # at 20 Hz: a quarter of a second

    def frames(*overrides):
        return make_plan(read_preset(preset, overrides)).frame_count

    assert frames("scenes.0.trajectory.every=2") == 3
    assert frames("scenes.0.trajectory.start=1", "scenes.0.trajectory.stop=3") == 2
    assert frames("scenes.0.trajectory.resample_hz=100") == 26
    assert frames("scenes.0.trajectory={handheld: {frames: 9}}") == 9


def test_every_key_is_listed_with_its_meaning():
    rows = dict(preset_keys())
    for name in ("seed", "scenes[].mesh", "camera.fx", "render.samples", "settings[].name", "output.layout", "rig.rgb"):
        assert rows[name]
    assert "px" in rows["camera.fx"]
    assert "default 1" in rows["render.samples"]
