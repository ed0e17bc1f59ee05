# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files as bytes: read, or refused."""

import pytest
from refusals import refusal

from noisy_world.scenes.ply import read_ply


@pytest.fixture(scope="session")
def ply(tmp_path_factory):
    """The file that the bytes are written into."""
    path = tmp_path_factory.mktemp("ply") / "mesh.ply"
    path.touch()
    return path


@pytest.fixture(scope="session")
def read(ply):
    """The mesh that read_ply makes of these bytes."""

    def read_bytes(data):
        with ply.open("r+b") as file:  # emptying the file first makes the disk write it out: 0.5 ms against 0.04
            file.write(data)
            file.truncate()
        return read_ply(ply)

    return read_bytes


@pytest.fixture(scope="session")
def refuse(read, ply):
    """The one line of the error that these bytes give, without the path."""

    return lambda data: refusal(read, data, named=ply)
