# SPDX-License-Identifier: GPL-3.0-or-later
"""Noise on a folder of images: python folder.py IMAGES OUT."""

import sys
from pathlib import Path

import cv2

from noisy_world.perturb import apply

images, out = map(Path, sys.argv[1:3])
out.mkdir(parents=True, exist_ok=True)
for frame, file in enumerate(sorted(images.glob("*.png"))):
    rgb = cv2.imread(str(file), cv2.IMREAD_COLOR_RGB)
    noisy = apply(rgb, "gaussian_noise", severity=3, seed=7, frame=frame)
    cv2.imwrite(str(out / file.name), noisy[..., ::-1])
