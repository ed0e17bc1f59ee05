# SPDX-License-Identifier: GPL-3.0-or-later
"""PLY files as bytes: read, or refused."""

import pytest

from noisy_world.core.errors import InputError
from noisy_world.core.scenes.ply import read_ply


@pytest.fixture(scope="session")
def read(tmp_path_factory):
    """The mesh that read_ply makes of these bytes."""
    path = tmp_path_factory.mktemp("ply") / "mesh.ply"
    path.touch()

    def read_bytes(data):
        with path.open("r+b") as file:  # emptying the file first makes the disk write it out: 0.5 ms against 0.04
            file.write(data)
            file.truncate()
        return read_ply(path)

    return read_bytes


@pytest.fixture(scope="session")
def refuse(read):
    """The one line of the error that these bytes give, without the path."""

    def message(data):
        with pytest.raises(InputError) as caught:
            read(data)
        text = str(caught.value)
        assert "\n" not in text
        assert caught.value.file.endswith("mesh.ply")
        assert text.startswith(caught.value.file + ": ")
        return text.removeprefix(caught.value.file + ": ")

    return message
