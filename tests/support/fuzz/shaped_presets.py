# SPDX-License-Identifier: GPL-3.0-or-later
"""Presets made by the schema of their keys, then changed by structure."""

from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints
import json
import types

import numpy as np
from fuzz import presets, recordings
from fuzz.mutation import pick
from fuzz.structure import RAWS, as_yaml, changed, note
from worlds import write_box_ply, write_replica, path_poses

from noisy_world.core.datasets.layouts import LAYOUTS
from noisy_world.core.perturbing.kinds import SEQUENCE_KINDS, PairingPerturbation
from noisy_world.core.presets.preset import EMBREE_SAMPLES, WORKBENCH_SAMPLES, CameraSpec, RenderSpec
from noisy_world.core.presets.scene_keys import HandheldSpec
from noisy_world.core.trajectories.pose_text import FORMATS
from noisy_world.core.perturbing.reading import is_sensor
from noisy_world.perturbations import registry

WORDS = (
    "mesh.ply",
    "traj.txt",
    "recording",
    "fog",
    "static",
    "dynamic",
    "keyed",
    "box",
    "*",
    "embedded:room",
    "preset.yaml",
)


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
    camera |= {"width": int(rng.integers(1, 5000)), "height": int(rng.integers(1, 5000))}
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


def write(folder, rng):
    """Write preset.yaml, and the files that it names."""
    write_box_ply(folder / "mesh.ply")
    write_replica(folder / "traj.txt", path_poses(6))
    (folder / "recording").mkdir()
    recordings.replica(folder / "recording", np.random.default_rng(2))
    camera = {"w": 8, "h": 6, "fx": 6.0, "fy": 6.0, "cx": 3.5, "cy": 2.5, "scale": 6553.5}
    (folder / "recording/cam_params.json").write_text(json.dumps({"camera": camera}))
    (folder / "outside").mkdir()
    (folder / "outside/kept.txt").write_text("somebody's")
    tree, told = changed(_document(rng), rng, raws=RAWS, words=(*WORDS, *FORMATS))
    (folder / "preset.yaml").write_bytes(as_yaml(tree, flow=bool(rng.integers(2))))
    note(folder, told)


read = presets.read
differs = presets.differs
