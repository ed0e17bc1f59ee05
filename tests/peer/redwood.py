# SPDX-License-Identifier: GPL-3.0-or-later
"""Open3D's noise of depth in its deterministic mode: redwood.py FOLDER reads model.txt, depth.npy; writes made.npy."""

import sys
from pathlib import Path

from compiled_open3d import open3d
import numpy as np

folder = Path(sys.argv[1])
o3d = open3d()
simulator = o3d.t.io.DepthNoiseSimulator(str(folder / "model.txt"))
simulator.enable_deterministic_debug_mode()
depth_m = np.load(folder / "depth.npy")
image = o3d.t.geometry.Image(o3d.core.Tensor(depth_m[..., None]))
np.save(folder / "made.npy", simulator.simulate(image, depth_scale=1.0).as_tensor().numpy()[..., 0])
