# SPDX-License-Identifier: GPL-3.0-or-later
"""Mutated presets, whose documents are compared with what PyYAML's safe loader reads."""

import datetime
import math
import re

import yaml
from fuzz.mutation import NUMBERS, mutate_bytes, mutate_mixed, mutate_text, pick
from worlds import ROOT, write_world

from noisy_world.core.planning.plan import read_settings
from noisy_world.core.presets.preset import read_preset
from noisy_world.perturbations import registry
from noisy_world.planning import make_plan
from noisy_world.sources import read_scenes

WORDS = (
    *NUMBERS, "yes", "no", "on", "off", "y", "null", "~", "", "<<", "=", "<<: *a", "&a ", "*a", "*b", "? ", ": ",
    "- ", "!!int ", "!!float ", "!!str ", "!!bool ", "!!null ", "!!set ", "!!map ", "!!seq ", "!!omap ", "!!pairs ",
    "!!binary ", "!!timestamp ", "!!merge ", "!!python/name:os.system ", "!own ", "! ", "!<tag:yaml.org,2002:int> ",
    "0b_", "0x", "0x_", "._e5", "_1", "1_", "2001-01-01", "2001-99-99", "2001-01-01 10:00:00", "1:99", "1:59.5",
    "-1:30", "|\n", ">-\n", "'", '"', '"\\ud800"', '"\\0"', '"\\UFFFFFFFF"', "---\n", "...\n", "%YAML 1.1\n", "\t",
    "%TAG ! x\n", "{[a]: b}", "{a: b}", "[a]", "[]", "{}", "[" * 40, "{a: " * 40, "#", "\ufeff", "\u2028", "severity",
    "levels", "fog", "mode", "dynamic", "sweep", "perturb", "name", "scenes", "settings", "mesh", "trajectory",
    "handheld", "*", "../x", "{perturb}", "{x", "parameters", "without", "include", "replica", "only", "room0", "data",
)  # fmt: skip

BASES = (
    """# every key
scenes:
  - name: box
    mesh: mesh.ply
    trajectory: {file: traj.txt, pose: c2w, axes: opencv, start: 0, every: 2}
  - {name: again, mesh: mesh.ply, trajectory: traj.txt}
seed: 3
camera: {width: 64, height: 48, fx: 32.0, fy: 3.2e+1, cx: 31.5, cy: 23.5, near_m: 0.01, far_m: 1e2}
render: {engine: cycles, backend: reference, samples: 1}
output: {layout: tum, image: png, modalities: [rgb, depth], overview: no}
settings:
  - {name: clean}
  - {name: fog_s3, perturb: [{fog: {severity: 3, mode: static}}]}
  - sweep: {perturb: [snow, frost], severities: [1, 3, 5], modes: [static, dynamic]}
""",
    """scenes: [&s {mesh: mesh.ply, trajectory: traj.txt, name: one}, {<<: *s, name: "two"}]
settings:
  - name: &n 'clean'
  - {name: many, perturb: &p [{gaussian_noise: {std: .05}}, {desync: {offset: -1, edge: drop}}]}
  - {name: late, perturb: *p, backend: reference}
  - name: levels
    perturb:
      - fog: {mode: dynamic, levels: [1, 2.5, 5], temporal: drift}
      - {depth_random_missing: {severity: 0x2}}
""",
    """? scenes
: - mesh: >-
      mesh.ply
    trajectory: {file: "traj.txt", resample_hz: 1_0.0, rate_hz: 20}
rig: {rgb: {translation_m: [0, 0.1, +.2], quat_wxyz: [1.0, 0, 0, 0]}, depth: {rotation_euler_deg: [0, 0, -9e-1]}}
seed: !!int "12"
""",
    """scenes: [{mesh: "embedded:room", trajectory: {handheld: {frames: 20, rate_hz: 20, speed_m_s: .5}}}]
settings: [{name: clean}, {name: shaky, perturb: [{motion_deviation: {rotation_deg: 3, translation_m: 0.05}}]}]
""",
    """scenes: [{mesh: "mesh.ply", trajectory: traj.txt, name: box}, {replica: "room*", trajectory: {every: 2}}]
data: .
only: {scenes: [box], settings: ["f*", clean, "d_?deg_0.5m"]}
settings:
  - {name: clean}
  - sweep: {perturb: [fog], severities: [3], parameters: {uniform: [true, false]}, name: "f{severity}_{uniform}"}
  - sweep: {perturb: [motion_deviation], parameters: {rotation_deg: [0, 1], translation_m: [0, 0.5]},
            without: [{rotation_deg: 0, translation_m: 0}], name: "d_{rotation_deg}deg_{translation_m}m"}
  - sweep: {perturb: [desync], parameters: {offset: [1]}, modes: [dynamic], name: "late{offset}_{mode}"}
  - {include: preset.yaml}
""",
)
NUMBER_OF_1_2 = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")


def write(folder, rng):
    """Write preset.yaml, often with overrides in set.txt, and the files that it names."""
    write_world(folder, frames=4)
    # Not the benchmarks: planning a thousand sequences takes seconds.
    shipped = [path for path in sorted((ROOT / "presets").rglob("*.yaml")) if not path.name.startswith("noisy_")]
    text = pick(rng, BASES) if rng.integers(4) else pick(rng, shipped).read_text()
    match int(rng.integers(8)):
        case 0:
            data = mutate_bytes(text.encode(), rng)
        case 1:
            data = mutate_text(text, rng, WORDS).encode("utf-16", "surrogatepass")
        case 2 | 3:
            document = yaml.safe_load(text)
            _replace_somewhere(document, rng)
            data = yaml.safe_dump(document, allow_unicode=True, default_flow_style=bool(rng.integers(2))).encode()
        case _:
            data = mutate_mixed(text, rng, WORDS)
    (folder / "preset.yaml").write_bytes(data)
    if rng.integers(4) == 0:
        told = pick(rng, ("seed=3", "render.samples=16", "scenes.0.trajectory.every=3", "settings.1={name: x}"))
        override = mutate_text(told, rng, WORDS).replace("\0", "").encode("utf-8", "surrogatepass")
        (folder / "set.txt").write_bytes(override)


def _replace_somewhere(document, rng):
    """Replace, remove or repeat a value of a document, or add a key."""
    node = document
    while True:
        names = list(node) if isinstance(node, dict) else list(range(len(node)))
        if not names:
            return
        name = pick(rng, names)
        if isinstance(node[name], (dict, list)) and rng.integers(4):
            node = node[name]
            continue
        match int(rng.integers(4)):
            case 0:
                del node[name]
            case 1 if isinstance(node, list):
                node.append(node[name])
            case 1:
                node[str(pick(rng, WORDS)).strip() or "x"] = node[name]
            case _:
                node[name] = pick(rng, ODD_VALUES)
        return


ODD_VALUES = (
    None, True, False, 0, -1, 2, 10**6, 2**31, 2**63, 10**400, 0.5, -0.5, 1e-300, 1e300, float("nan"), float("inf"),
    "", "x", "yes", "1e-3", "../x", "a\nb", "é", "😀", "x" * 300, "*", "**", "[", "embedded:room", "~", "/", "mesh.ply",
    [], [1], [[]], {}, {"a": 1}, {"": 1}, [None], {"fog": None}, [{"fog": 3}], list(range(40)), ["fog", "snow"],
    datetime.date(2001, 1, 1), b"bytes",
)  # fmt: skip


def read(folder):
    """Read the preset as the command line does; return its document, before overrides."""
    path = folder / "preset.yaml"
    preset = read_preset(path)
    if (told := folder / "set.txt").exists():
        preset = read_preset(path, [told.read_bytes().decode("utf-8", "surrogateescape")])
    settings = read_settings(preset, registry())
    paths = [getattr(scene.keys, "trajectory", None) for scene in read_scenes(preset)]
    if all(path is None or path.handheld is None for path in paths):
        make_plan(preset)
    assert settings
    assert len(preset.sha256) == 64
    return read_preset(path).document


def differs(folder, document, _peer):
    """Return how the document differs from that of PyYAML's safe loader, or ""."""
    try:
        expected = yaml.safe_load((folder / "preset.yaml").read_bytes())
    except ValueError:
        return ""  # a date that does not exist, which is a text for us
    camera = expected.get("camera") if isinstance(expected, dict) else None
    if isinstance(camera, dict) and camera.get("device") is not None:  # it stands for other keys, recorded as these
        document, expected = (
            {key: part for key, part in each.items() if key != "camera"} for each in (document, expected)
        )
    return difference(document, expected)


def difference(ours, theirs, path=""):
    """Return the first place where two values differ, or "".

    Ours may read numbers as YAML 1.2 spells them, and dates as texts.
    """
    if isinstance(theirs, dict) and isinstance(ours, dict):
        if list(map(str, sorted(map(str, ours)))) != sorted(map(str, theirs)):
            return f"{path}: keys {sorted(ours)} and {sorted(map(str, theirs))}"
        return next((told for name in ours if (told := difference(ours[name], theirs[name], f"{path}.{name}"))), "")
    if isinstance(theirs, list) and isinstance(ours, list) and len(ours) == len(theirs):
        pairs = enumerate(zip(ours, theirs, strict=True))
        return next((told for k, (one, other) in pairs if (told := difference(one, other, f"{path}.{k}"))), "")
    if type(ours) is type(theirs) and (ours == theirs or (isinstance(ours, float) and math.isnan(ours + theirs))):
        return ""
    if (
        isinstance(ours, float)
        and isinstance(theirs, str)
        and NUMBER_OF_1_2.fullmatch(theirs)
        and ours == float(theirs)
    ):
        return ""
    if isinstance(ours, str) and isinstance(theirs, (datetime.date, datetime.datetime)):
        return ""
    return f"{path}: {ours!r} and {theirs!r}"
