# SPDX-License-Identifier: GPL-3.0-or-later
"""Open3D's compiled module without its package, which imports windows, plots and a web server: some fifty packages."""

import importlib.util
from importlib.metadata import distribution


def open3d():
    """Return the module, whose parts are called as those of the package are."""
    path = next(file for file in distribution("open3d").files or [] if file.match("open3d/cpu/pybind*.so")).locate()
    spec = importlib.util.spec_from_file_location("open3d.cpu.pybind", str(path))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
