# SPDX-License-Identifier: GPL-3.0-or-later
"""The core is tested as it has to work: without Blender."""

import sys

import pytest


@pytest.fixture(autouse=True)
def _no_bpy(monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", None)  # importing it raises ImportError
