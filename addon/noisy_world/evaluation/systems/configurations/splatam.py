# SPDX-License-Identifier: GPL-3.0-or-later
"""SplaTAM-S (https://github.com/spla-tam/SplaTAM): `scripts/splatam.py CONFIGURATION`.

A configuration is a Python file. Ours takes that of configs/replica/splatam_s.py in the checkout and replaces what
depends on the sequence. Parameters: WORKDIR/RUN_NAME/params.npz, written when all frames are done.
"""

from pathlib import Path
from typing import Any

from ....core.datasets.image_reading import read_pixels
from ....core.errors import InputError
from ....core.yaml_reading import yaml_text
from ...estimates.frames import Index
from .given import RESULT, SEQUENCE, camera_keys, write_sequence, write_text


def splatam_s(index: Index, folder: Path) -> list[str]:
    """Write sequence and configuration into a run's folder; return the arguments of Python.

    Raises InputError where the images are grey, which its loader does not read.
    """
    _check_colour(index)
    write_sequence(index, folder)
    camera = camera_keys(index)
    size = {"image_height": camera.pop("H"), "image_width": camera.pop("W")}
    data = {"dataset_name": "replica", "camera_params": {**size, **camera, "crop_edge": 0}}
    dataset = write_text(folder / "dataset.yaml", yaml_text(data))
    height, width = size["image_height"], size["image_width"]
    replaced: dict[str, Any] = {
        "basedir": str(folder),
        "sequence": SEQUENCE,
        "gradslam_data_cfg": str(dataset),
        "desired_image_height": height,
        "desired_image_width": width,
        "tracking_image_height": height,
        "tracking_image_width": width,
        "densification_image_height": max(1, height // 2),  # as published: half of the image
        "densification_image_width": max(1, width // 2),
        "num_frames": len(index["frames"]),
    }
    lines = [
        "import runpy",
        "",
        'config = runpy.run_path("configs/replica/splatam_s.py")["config"]',
        f"config.update(workdir={str(folder)!r}, run_name={RESULT!r}, use_wandb=False)",
        f"config['data'].update({replaced!r})",
    ]
    configuration = write_text(folder / "configuration.py", "\n".join(lines) + "\n")
    return ["scripts/splatam.py", str(configuration)]


def _check_colour(index: Index) -> None:
    import cv2

    file = index["frames"][0]["colour"] if index["frames"] else ""
    image = read_pixels(Path(file), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 3:
        raise InputError(file, "is no image of three channels, as SplaTAM reads them", remedy="set output.colour: rgb")
