# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets: some whose words and bytes are mutated, and some made by the schema of their keys and changed by structure.

Documents are compared with what PyYAML's safe loader reads.
"""

import datetime
import math
import re
import shutil
import types
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import yaml
from recorded_layouts import replica
from fuzz.mutation import NUMBERS, mutate_bytes, mutate_mixed, mutate_text, pick
from fuzz.structure import as_yaml, beside, changed, kept, note
from worlds import ROOT, path_poses, write_box_ply, write_replica, write_world

from noisy_world.layouts import LAYOUTS
from noisy_world.perturbations.kinds import SEQUENCE_KINDS, PairingPerturbation
from noisy_world.perturbations.parsing import is_sensor
from noisy_world.dataset.plan import read_settings
from noisy_world.preset.keys import EMBREE_SAMPLES, WORKBENCH_SAMPLES, CameraSpec, RenderSpec, read_preset
from noisy_world.preset.scene_keys import HandheldSpec
from noisy_world.trajectories.formats import TRAJECTORY_FORMATS
from noisy_world.perturbations import registry
from noisy_world.dataset.plan import make_plan
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
            data = as_yaml(changed(yaml.safe_load(text), rng, words=WORDS)[0], flow=bool(rng.integers(2)))
        case _:
            data = mutate_mixed(text, rng, WORDS)
    (folder / "preset.yaml").write_bytes(data)
    if rng.integers(4) == 0:
        told = pick(rng, ("seed=3", "render.samples=16", "scenes.0.trajectory.every=3", "settings.1={name: x}"))
        override = mutate_text(told, rng, WORDS).replace("\0", "").encode("utf-8", "surrogatepass")
        (folder / "set.txt").write_bytes(override)


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


def differs(folder, document):
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


# --- presets by their schema ---

WORDS_OF_SCENES = (
    "mesh.ply", "traj.txt", "recording", "fog", "static", "dynamic", "keyed", "box", "*", "embedded:room",
    "preset.yaml",
)  # fmt: skip


# What no recording can do: be seen from elsewhere, or at other moments.
ELSEWHERE = {"motion_deviation", "vibration", "drift", "jerk", "rolling_shutter", "camera_motion_blur"}


def _of_schema(cls, rng, likely=0.4):
    """Return a mapping that sets some keys of a dataclass, each within its range."""
    hints = get_type_hints(cls)
    found = {}
    for item in fields(cls):
        required = item.default is MISSING and item.default_factory is MISSING
        if required or rng.random() < likely:
            found[item.name] = _value(hints[item.name], item.metadata["key"], rng)
    return found


def _value(hint: Any, info: Any, rng):
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        return _value(next(option for option in get_args(hint) if option is not type(None)), info, rng)
    if origin is Literal:
        return pick(rng, get_args(hint))
    if hint is bool:
        return bool(rng.integers(2))
    if hint is str and info.file is not None:
        return ""  # no file
    if hint is str:
        return pick(rng, tuple(info.choices)) if info.choices else "x"
    if hint in (int, float):
        low = info.minimum if info.minimum is not None else info.above if info.above is not None else -1.0
        high = min(info.maximum if info.maximum is not None else 10.0, max(10.0, 2 * low))
        if hint is int:
            return int(rng.integers(int(low), int(high) + 1))
        return float(high) if rng.random() < 0.1 else float(low + (high - low) * rng.uniform(0.05, 1.0))
    if is_dataclass(hint):
        return _of_schema(hint, rng)
    raise TypeError(f"no value is known for {hint}")


def _scene(rng, number):
    """Return a scene of a kind that needs no Blender to be planned."""
    name = {"name": f"scene{number}"}
    cut = {key: value for key, value in {"start": 0, "stop": 3, "every": 2}.items() if rng.integers(3) == 0}
    match int(rng.integers(5)):
        case 0:
            return {"sequence": "recording", **name, **({"poses": "keep"} if rng.integers(2) else {})}
        case 1:
            return {"mesh": "mesh.ply", "trajectory": "traj.txt", **name}
        case 2:
            told = {"file": "traj.txt", "format": "replica", "pose": pick(rng, ("c2w", "w2c")), **cut}
            return {"mesh": "mesh.ply", "up": pick(rng, ("y", "z")), "trajectory": told, **name}
        case 3:
            path = {**_of_schema(HandheldSpec, rng), "frames": int(rng.integers(1, 30))}
            return {"mesh": "embedded:room?seed=1", "trajectory": {"handheld": path}, **name}
        case _:
            resampled = {"file": "traj.txt", "rate_hz": 10.0, "resample_hz": float(rng.uniform(1, 40))}
            return {"mesh": "mesh.ply", "trajectory": resampled, **name}


def _step(rng, known):
    """Return a perturbation with values that its own schema allows."""
    found = known[pick(rng, tuple(known))]
    if isinstance(found, PairingPerturbation):  # whose values may leave no frame of a short path
        return {found.name: {"offset": 1} if found.name == "desync" else None}
    inside = _of_schema(found.parameters, rng, 0.3) if rng.integers(2) else {}
    contradiction = getattr(found, "contradiction", None)
    if contradiction is not None and contradiction(found.parameters(**inside)):
        inside = {}
    if found.temporals and rng.integers(3) == 0:
        inside["temporal"] = pick(rng, found.temporals)
    if found.severities and not inside.keys() & found.severities.keys():
        inside |= _severity(rng, whole=isinstance(found, SEQUENCE_KINDS))
    return {found.name: inside or None}


def _severity(rng, *, whole):
    if whole or rng.integers(2):
        return {"severity": float(rng.integers(1, 6))}
    if rng.integers(2):
        return {"mode": "dynamic", "levels": [0, 1, 2.5, 5][: int(rng.integers(1, 5))]}
    return {"mode": "dynamic", "severity": int(rng.integers(1, 6))}


def _setting(rng, number, known):
    if rng.integers(4) == 0:
        names = [name for name, each in known.items() if each.severities and not isinstance(each, SEQUENCE_KINDS)]
        chosen = [names[k] for k in rng.permutation(len(names))[: int(rng.integers(1, 4))]]
        return {"sweep": {"perturb": chosen, "severities": [1, 3.0, 5], "name": f"{number}_{{perturb}}_{{severity}}"}}
    steps = {}
    for _ in range(int(rng.integers(0, 4))):
        steps |= {name: {name: value} for name, value in _step(rng, known).items()}
    measuring = [name for name in steps if is_sensor(known[name])]  # depth is measured once
    kept = [step for name, step in steps.items() if name not in measuring[1:]]
    return {"name": f"setting{number}", "perturb": kept}


def _document(rng):
    camera = {**_of_schema(CameraSpec, rng), "near_m": 0.01, "far_m": float(rng.uniform(1, 1e6))}
    camera.pop("distortion", None)  # most lenses fold over in most images
    camera.pop("device", None)  # stands for other keys, and is recorded as these
    for focal, middle, length in (("fx", "cx", "width"), ("fy", "cy", "height")):  # another unit is refused
        length_px = int(rng.integers(1, 5000))
        lens = {focal: length_px * rng.uniform(0.01, 10), middle: length_px * rng.uniform(-3, 4)}
        camera |= {length: length_px, **{name: float(value) for name, value in lens.items()}}
    layout = LAYOUTS[pick(rng, tuple(LAYOUTS))]
    render = {**_of_schema(RenderSpec, rng), "device": "cpu", "backend": "reference"}
    offered = {"workbench": WORKBENCH_SAMPLES, "embree": EMBREE_SAMPLES}
    render["samples"] = pick(rng, offered.get(str(render.get("engine")), (1,)))
    scenes = [_scene(rng, k) for k in range(int(rng.integers(1, 4)))]
    recorded = any("sequence" in scene for scene in scenes)
    known = {name: each for name, each in registry().items() if not (recorded and name in ELSEWHERE)}
    if render.get("engine") != "embree":
        known = {name: each for name, each in known.items() if not getattr(each, "rays", None)}
    document = {
        "scenes": scenes,
        "settings": [_setting(rng, k, known) for k in range(int(rng.integers(1, 5)))],
        "seed": int(rng.integers(2**63)),
        "render": render,
        "output": {
            "layout": layout.name,
            "image": pick(rng, [each for each in layout.images if each != "exr"]),
            "modalities": ["rgb", "depth"],
        },
    }
    if not recorded:
        document["camera"] = camera
        if rng.integers(3) == 0:
            document["rig"] = {"rgb": {"translation_m": [0.1, 0.0, 0.2], "quat_wxyz": [1.0, 0.0, 0.0, 0.0]}}
    return document


def write_shaped(folder, rng):
    """Write preset.yaml, and the files that it names."""
    write_box_ply(folder / "mesh.ply")
    write_replica(folder / "traj.txt", path_poses(6))
    if not (kept("shaped") / "recording").exists():
        (kept("shaped") / "recording").mkdir()
        replica(kept("shaped") / "recording")
    shutil.copytree(kept("shaped") / "recording", folder / "recording")
    beside(folder)
    tree, told = changed(_document(rng), rng, words=(*WORDS_OF_SCENES, *TRAJECTORY_FORMATS))
    (folder / "preset.yaml").write_bytes(as_yaml(tree, flow=bool(rng.integers(2))))
    note(folder, told)
