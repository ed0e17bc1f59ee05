# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's engines: EEVEE and Workbench need software GL, which is asked for once, by the first test that needs it."""

import functools

import pytest

from noisy_world.render.engines import gl_version
from noisy_world.core.errors import NoisyWorldError

OF_GL = ("eevee", "workbench")
each_engine = pytest.mark.parametrize("engine", ["cycles", *OF_GL])
other_engines_at_length = pytest.mark.parametrize(  # EEVEE takes more than a second to begin
    "engine", ["cycles", "workbench", pytest.param("eevee", marks=pytest.mark.long)]
)
gl_engines = pytest.mark.parametrize("engine", OF_GL)


@functools.cache
def gl_problem():
    """Return why nothing is drawn by GL here, or ""."""
    try:
        gl_version()
    except NoisyWorldError as error:
        return str(error)
    return ""


def need_gl(engine):
    """Skip a test of an engine that needs software GL, where there is none."""
    if engine in OF_GL and gl_problem():
        pytest.skip(f"no software GL here: {gl_problem()}")
