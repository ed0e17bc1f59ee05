# SPDX-License-Identifier: GPL-3.0-or-later
"""A dataset's provenance: its identity, which is everything that decides its bytes, and its manifest."""

import platform
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..machine import processor_features
from ..planning.plan import Plan
from .depth_range import RangeLoss
from .records import OUT_OF_RANGE

FORMAT = 1  # version of the identity and the manifest; raised when their keys change

CONVENTIONS = {
    "pose": "camera-to-world; camera axes x right, y down, z forward (OpenCV); metres; world z up",
    "depth": "planar depth z of the pixel's centre; uint16 = round(metres * depth_scale_per_m); 0 is void",
    "rgb": "RGB, 8 bits, sRGB-encoded; void is black",
    "pixel": "integer coordinates name pixel centres; the principal point is given in them",
    "time": "seconds",
}
GREY = {"rgb": "grey, 8 bits: 0.299 R + 0.587 G + 0.114 B of sRGB-encoded values (ITU-R BT.601); void is black"}


def package_version() -> str:
    """Return this package's version from blender_manifest.toml, its only source: in the package or a folder above."""
    package = Path(__file__).resolve().parents[2]
    for folder in (package, *package.parents[:2]):
        manifest = folder / "blender_manifest.toml"
        if manifest.is_file():
            found = re.search(r'^version\s*=\s*"([^"]+)"', manifest.read_text(encoding="utf-8"), re.MULTILINE)
            if found:
                return found[1]
    raise RuntimeError(f"no blender_manifest.toml with a version at {package} or above")


def identity(plan: Plan, renderer: Mapping[str, str]) -> dict[str, Any]:
    """Return what decides every byte of a dataset; two runs with the same identity write the same files.

    renderer: the versions of what renders, by name.

    Which frames a run makes (--frames) is not part of it: frames keep their numbers and their bytes.
    """
    import cv2
    import OpenEXR

    return {
        "format": FORMAT,
        "preset": plan.preset.document,
        "preset_sha256": plan.preset.sha256,
        "backends": {setting.name: setting.backend for setting in plan.settings if setting.rgb},
        "inputs": {scene.name: scene.source.hashes() for scene in plan.scenes},
        "sequences": [sequence.folder for sequence in plan.sequences],
        "versions": {
            **_perturbation_packages(plan),
            "noisy_world": package_version(),
            **renderer,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "opencv": cv2.__version__,
            "openexr": OpenEXR.__version__,
        },
        "processor": {
            "machine": platform.machine(),
            "byte_order": sys.byteorder,
            "features": processor_features(),
        },
    }


def _perturbation_packages(plan: Plan) -> dict[str, str]:
    """Return the versions of the installed packages whose perturbations the preset uses, by name."""
    used = [step.perturbation.distribution for setting in plan.settings for step in setting.steps]
    return {item.name: item.version for item in used if item is not None}


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
    camera = plan.camera
    spec = plan.preset.spec
    return {
        "identity": identity_,
        "seeds": {"preset": spec.seed, "render": render_seed(spec.seed)},
        "camera": {
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "fx_px": camera.fx_px,
            "fy_px": camera.fy_px,
            "cx_px": camera.cx_px,
            "cy_px": camera.cy_px,
            "near_m": spec.camera.near_m,
            "far_m": spec.camera.far_m,
        },
        "depth_scale_per_m": plan.format.depth_scale_per_m,
        "depth_limit_m": plan.format.depth_limit_m,
        "depth_beyond": plan.format.depth_beyond,
        OUT_OF_RANGE: {folder: loss.content() for folder, loss in losses.items()},
        "colour": plan.format.colour,
        "conventions": CONVENTIONS | (GREY if plan.format.colour == "grey" else {}) | plan.format.layout.conventions,
        "frames": frames,
        "files": files,
    }


def render_seed(seed: int) -> int:
    """Return the seed of the renderer's sampling pattern, which takes 31 bits."""
    return seed % 2**31
