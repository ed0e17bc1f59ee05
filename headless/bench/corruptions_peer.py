# SPDX-License-Identifier: GPL-3.0-or-later
"""imagecorruptions and scikit-image's metrics, in their own Python: the library that others corrupt images with.

    .venv-corruptions/bin/python headless/bench/corruptions_peer.py FRAMES.npy

FRAMES.npy: (N, H, W, 3) uint8 RGB. Reads JSON lines and answers `@{...}`:
{"do": "time", "name": ..., "severity": ..., "frames": [...]} -> processor seconds a frame;
{"do": "metrics", "file": OTHER.npy} -> means of PSNR, SSIM (scikit-image's default on RGB) and shift against FRAMES.
"""

import json
import sys
import time
from typing import Any

import cv2
import imagecorruptions
import numpy as np
from skimage.filters import gaussian
from skimage.metrics import structural_similarity


def main(path: str) -> None:
    """Load, and answer."""
    cv2.setNumThreads(1)
    imagecorruptions.corruptions.gaussian = blurred
    frames = np.load(path)
    print("@" + json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        order = json.loads(line)
        if order["do"] == "time":
            start_s = time.process_time()
            for index in order["frames"]:
                imagecorruptions.corrupt(frames[index], severity=order["severity"], corruption_name=order["name"])
            print("@" + json.dumps({"frame_s": (time.process_time() - start_s) / len(order["frames"])}), flush=True)
        else:
            others = np.load(order["file"])
            found = [metrics(clean, other) for clean, other in zip(frames, others, strict=True)]
            psnr, ssim, shift = np.mean(found, axis=0).tolist()
            print("@" + json.dumps({"psnr": psnr, "ssim": ssim, "mean_shift": shift}), flush=True)


def blurred(image: np.ndarray, sigma: float, *, multichannel: bool = False, **options: Any) -> np.ndarray:
    """Call scikit-image's Gaussian in its words of today: 0.20 does not take imagecorruptions' `multichannel`."""
    return gaussian(image, sigma, channel_axis=-1 if multichannel else None, **options)


def metrics(clean: np.ndarray, other: np.ndarray) -> tuple[float, float, float]:
    """Return PSNR (dB), SSIM and mean shift (of 255) of one frame."""
    difference = other.astype(np.float64) - clean
    psnr = 10 * np.log10(255**2 / np.mean(difference**2))
    return psnr, structural_similarity(clean, other, channel_axis=2), difference.mean()


if __name__ == "__main__":
    main(*sys.argv[1:])
