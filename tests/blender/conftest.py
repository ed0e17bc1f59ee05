# SPDX-License-Identifier: GPL-3.0-or-later
"""What is tested here has Blender in its process, and looks at scenes there, too: another takes a second to start."""

import importlib.util

import pytest

collect_ignore_glob = [] if importlib.util.find_spec("bpy") else ["test_*.py"]
IN_A_PROCESS_OF_ITS_OWN = ("test_blend_refusals.py",)


@pytest.fixture(scope="module", autouse=True)
def _looks_here(request):
    if request.path.name in IN_A_PROCESS_OF_ITS_OWN:
        yield
        return
    from importing import look_here

    with pytest.MonkeyPatch.context() as patched:
        look_here(patched)
        yield
