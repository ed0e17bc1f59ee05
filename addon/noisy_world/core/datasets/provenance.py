# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset's provenance: its identity, which is everything that decides its bytes, and its manifest.

An identity says what is common to all frames, and by name what belongs to each scene and to each setting: a dataset
grows by scenes, settings and frames, and each keeps what it was made from.
"""

import hashlib
import json
import platform
import sys
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import CHANNELS as REGISTERED
from ..channels import COLOUR_AND_DEPTH, surface_channels
from ..geometry import Intrinsics
from ..machine import processor_features
from ..optics import OPTICS_KEYS
from ..planning.plan import Plan
from ..planning.scene import Scene, SceneEntry
from ..presets.preset import canonical
from ..schema import deciding_values
from ..shipped import package_version
from ..trajectories.rig import Rig, Sensor
from ..trajectories.trajectory import Trajectory
from ..utf8_names import NOT_UTF8, RENAME, is_utf8
from .depth_range import RangeLoss
from .json_text import plain_values
from .layouts import EVERY, OutputFormat
from .recorded_setting import KEYS, RecordedSetting
from .records import OUT_OF_RANGE
from .storage import sha256_of_file

FORMAT = 2  # version of the identity and the manifest; raised when their keys change

CONVENTIONS = {
    "pose": "camera-to-world; camera axes x right, y down, z forward (OpenCV); metres; world z up",
    **{name: REGISTERED[name].convention for name in COLOUR_AND_DEPTH},
    "pixel": "integer coordinates name pixel centres; the principal point is given in them",
    "time": "seconds",
}
CHANNELS = "channels"  # of a scene: the files that say what the values of its channels mean
BETWEEN = "between_sha256"  # of a path, where a setting looks between its poses
HUFFMAN = "huffman"  # of the output: which JPEG images have Huffman tables of their own; none in datasets of before
GREY = {"rgb": "grey, 8 bits: 0.299 R + 0.587 G + 0.114 B of sRGB-encoded values (ITU-R BT.601); void is black"}


# --- the identity ---


def identity(plan: Plan, renderer: Mapping[str, str], *, paths: bool = True) -> dict[str, Any]:
    """Return what decides every byte of a dataset, as plain JSON values.

    renderer: the versions of what renders, by name. paths: whether to hash the scenes' paths, for which a generated
    path has to be made.

    What is compared is what the preset means: settings have their steps with all parameters, whether they were swept,
    written out or left to their defaults. The preset's document stands beside that for people. Which frames a run makes
    (--frames) is no part of it, nor what decides no bytes, such as the overview.
    """
    spec = plan.preset.spec
    rendered = plan.uses_render_settings
    cameras = {render.scene.name: render.camera for render in plan.renders}
    counts = {scene.name: scene.frame_count for scene in plan.scenes}
    return {
        "format": FORMAT,
        "preset": plan.preset.described,
        "preset_sha256": plan.preset.sha256,
        "seed": spec.seed,
        "near_m": spec.mesh_camera.near_m if rendered else None,
        "far_m": spec.mesh_camera.far_m if rendered else None,
        "rig": None if plan.rig is None else _rig(plan.rig),
        "render": {name: getattr(spec.render, name) for name in ("engine", "device", "samples")} if rendered else None,
        "output": _output(plan.format),
        "scenes": {scene.name: _scene(plan, scene, cameras[scene.name], paths) for scene in plan.scenes},
        "settings": {setting.name: RecordedSetting.of(setting).content() for setting in plan.settings},
        "sequences": {sequence.folder: counts[sequence.scene] for sequence in plan.sequences},
        "versions": {**_packages(plan), **renderer, **base_versions()},
        "processor": processor(),
        **_keys({name: value for name, value in deciding_values(spec).items() if not _of_part(name)}),
    }


def _keys(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an identity says of keys that decide bytes by their own values; nothing where all are the default."""
    return {KEYS: plain_values(dict(values))} if values else {}


def _of_part(name: str) -> bool:
    """Tell whether a key belongs to one scene or setting, where it is told."""
    return name.split(".", maxsplit=1)[0] in ("scenes", "settings")


def plain_identity(plan: Plan, renderer: Mapping[str, str], *, paths: bool = True) -> dict[str, Any]:
    """Return the identity as it is read back from a file: JSON turns tuples into lists, for instance."""
    return json.loads(canonical(identity(plan, renderer, paths=paths)))


def _sensor(sensor: Sensor | None) -> list[list[float]] | None:
    return None if sensor is None else (sensor.robot_from_sensor + 0.0).tolist()


def _rig(rig: Rig) -> dict[str, Any]:
    """Return the sensors' poses, and all that an IMU measures by; without one as datasets of before say it."""
    found: dict[str, Any] = {"rgb": _sensor(rig.rgb), "depth": _sensor(rig.depth)}
    if rig.imu is not None:
        content = {item.name: getattr(rig.imu, item.name) for item in fields(rig.imu)}
        content["robot_from_sensor"] = (rig.imu.robot_from_sensor + 0.0).tolist()
        found["imu"] = content | {"model": asdict(rig.imu.model)}
    return found


def _output(format_: OutputFormat) -> dict[str, Any]:
    coloured = "rgb" in format_.modalities
    formats = {name: kind for name, kind in format_.formats if name in format_.modalities}
    return {
        "layout": format_.layout.name,
        "image": format_.image if coloured else None,
        "colour": format_.colour if coloured else None,
        "depth_scale_per_m": format_.depth_scale_per_m,
        "depth_beyond": format_.depth_beyond,
        "modalities": sorted(format_.modalities),
        **({"formats": formats} if formats else {}),
        **({HUFFMAN: "perturbed noise"} if coloured and format_.image == "jpg" else {}),
    }


def _scene(plan: Plan, scene: Scene, camera: Intrinsics, paths: bool) -> dict[str, Any]:
    """Return what belongs to a scene. Its entry in the preset is for people; the path is compared by its poses."""
    path: dict[str, Any] = {"frames": scene.frame_count}
    if paths:
        path["sha256"] = path_sha256(scene.path, scene.source.stamps_s, scene.frame_count)
        own = [render for render in plan.renders if render.scene.name == scene.name]
        looked = any(render.exposure or (render.unit is not None and render.unit.clock) for render in own)
        if looked or (plan.rig is not None and plan.rig.imu is not None):
            path[BETWEEN] = between_sha256(scene.path)
    return {
        "entry": relevant_entry(scene.entry),
        "inputs": _inputs(scene),
        **_channels(plan, scene),
        "camera": _camera(camera),
        **scene.source.optics(camera).content(),
        "path": path,
        **_keys({} if scene.entry is None else scene.entry.deciding()),
    }


def _inputs(scene: Scene) -> dict[str, Any]:
    """Return the names and hashes of a scene's files. Raises InputError for a name that JSON cannot hold."""
    found = plain_values(scene.source.hashes())
    for text in found.values():
        if isinstance(text, str) and not is_utf8(text):
            raise scene.place.error(f"{text} {NOT_UTF8}", RENAME)
    return found


def _channels(plan: Plan, scene: Scene) -> dict[str, dict[str, str]]:
    """Return the hashes of files that say what the values of channels mean; nothing where there is none."""
    found = {
        f"{item.name}_sha256": hashlib.sha256("".join(map(str, map(sha256_of_file, files))).encode()).hexdigest()
        for item in surface_channels(plan.format.modalities)
        if (files := item.files(scene.source.location))
    }
    return {CHANNELS: found} if found else {}


def relevant_entry(entry: SceneEntry[Any] | None) -> dict[str, Any]:
    """Return a scene's entry of a preset as plain values, without keys that say nothing of it."""
    return {} if entry is None else plain_values(entry.recorded_keys())


def _camera(camera: Intrinsics) -> dict[str, float]:
    return {
        "width": camera.width_px,
        "height": camera.height_px,
        "fx": float(camera.fx_px),
        "fy": float(camera.fy_px),
        "cx": float(camera.cx_px),
        "cy": float(camera.cy_px),
    }


def path_sha256(path: Trajectory, stamps_s: NDArray[np.float64], count: int) -> str:
    """Return the SHA-256 of the first poses of a path and of their stamps, as float64; `count` of them."""
    digest = hashlib.sha256()
    for values in (path.c2w, path.stamps_s, stamps_s):
        digest.update(np.ascontiguousarray(values[:count] + 0.0, dtype="<f8").tobytes())  # -0.0 is 0.0
    if path.posed is not None:
        digest.update(path.posed[:count].tobytes())
    return digest.hexdigest()


def between_sha256(path: Trajectory) -> str:
    """Return the SHA-256 of where a path is halfway between its poses, as float64."""
    halfway_s = (path.stamps_s[:-1] + path.stamps_s[1:]) / 2
    c2w = path.continuous.pose_at(halfway_s)
    return hashlib.sha256(np.ascontiguousarray(c2w + 0.0, dtype="<f8").tobytes()).hexdigest()


def base_versions() -> dict[str, str]:
    """Return the versions of what every dataset is made with, by name."""
    import cv2
    import deflate
    import OpenEXR

    return {
        "noisy_world": package_version(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "openexr": OpenEXR.__version__,
        "deflate": deflate.__version__,
    }


def processor() -> dict[str, Any]:
    """Return the kind of processor that this is, as far as it decides bytes."""
    return {"machine": platform.machine(), "byte_order": sys.byteorder, "features": processor_features()}


def _packages(plan: Plan) -> dict[str, str]:
    """Return the versions of the installed packages whose perturbations, layout, channels or sources a plan uses."""
    used = [step.perturbation.distribution for setting in plan.settings for step in (*setting.sensor, *setting.steps)]
    used.append(EVERY.distribution(plan.format.layout.name))
    used += [REGISTERED.distribution(name) for name in plan.format.modalities]
    used += [scene.entry.distribution for scene in plan.scenes if scene.entry is not None]
    return {item.name: item.version for item in used if item is not None}


# --- the manifest ---


def manifest(
    plan: Plan,
    identity_: dict[str, Any],
    files: dict[str, Any],
    frames: dict[str, int],
    losses: Mapping[str, RangeLoss],
) -> dict[str, Any]:
    """Return the manifest's content.

    files: SHA-256 by name of the dataset's own files and, a level deeper, of each sequence's and setting's.
    frames: how many frames each sequence has. losses: the depth that the images of sequences cannot hold.
    """
    spec = plan.preset.spec
    clipping = {"near_m": spec.mesh_camera.near_m, "far_m": spec.mesh_camera.far_m}
    inputs = {name: scene["inputs"] for name, scene in identity_["scenes"].items()}
    seen = {name: {key: own.get(key, value) for key, value in clipping.items()} for name, own in inputs.items()}
    beyond = optics_of(identity_)
    cameras = {name: asdict(camera) | seen[name] | beyond[name] for name, camera in cameras_of(identity_).items()}
    shared = None
    if cameras_agree(identity_):
        first, *others = cameras.values()
        shared = {key: value for key, value in first.items() if all(camera[key] == value for camera in others)}
    return {
        "identity": identity_,
        "seeds": {"preset": spec.seed, "render": render_seed(spec.seed)},
        **({"cameras": cameras} if shared is None else {"camera": shared}),
        "depth_scale_per_m": plan.format.depth_scale_per_m,
        "depth_limit_m": plan.format.depth_limit_m,
        "depth_beyond": plan.format.depth_beyond,
        OUT_OF_RANGE: {folder: loss.content() for folder, loss in losses.items()},
        "colour": plan.format.colour,
        "conventions": conventions(plan.format),
        "frames": frames,
        "files": files,
    }


def conventions(format_: OutputFormat) -> dict[str, str]:
    """Return what the values in a dataset's files mean; colour and depth are told where they are left out, too."""
    channels = {name: REGISTERED[name].convention_in(REGISTERED[name].suffix(format_)) for name in format_.modalities}
    return CONVENTIONS | channels | (GREY if format_.colour == "grey" else {}) | format_.layout.conventions


def cameras_of(identity_: dict[str, Any]) -> dict[str, Intrinsics]:
    """Return the camera of each scene of a dataset, by its identity; scenes that an earlier run made are in it."""
    found = {name: scene["camera"] for name, scene in identity_["scenes"].items()}
    return {
        name: Intrinsics(camera["width"], camera["height"], *(camera[key] for key in ("fx", "fy", "cx", "cy")))
        for name, camera in found.items()
    }


def cameras_agree(identity_: dict[str, Any]) -> bool:
    """Tell whether all scenes of a dataset have one camera, so that a setting can say it for all of them."""
    beyond = list(optics_of(identity_).values())
    return len(set(cameras_of(identity_).values())) == 1 and all(item == beyond[0] for item in beyond)


def optics_of(identity_: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return what the cameras of each scene have beyond one pinhole, as plain values; {} for nothing."""
    scenes = identity_["scenes"].items()
    return {scene: {key: content[key] for key in OPTICS_KEYS if key in content} for scene, content in scenes}


def render_seed(seed: int) -> int:
    """Return the seed of the renderer's sampling pattern, which takes 31 bits."""
    return seed % 2**31
