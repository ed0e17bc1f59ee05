# SPDX-License-Identifier: GPL-3.0-or-later
import pytest

from noisy_world.core.errors import InputError
from noisy_world.core.trajectories.files import read_trajectory


@pytest.fixture
def write(tmp_path):
    def write_file(content, name="poses.txt"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return file

    return write_file


@pytest.fixture
def refused(write):
    """The message about a file that must not be read, without the file's own name in front."""

    def message(content, **how):
        file = write(content)
        with pytest.raises(InputError) as error:
            read_trajectory(file, **how)
        text = str(error.value)
        assert text.startswith(f"{file}: ")
        assert "\n" not in text
        return text.removeprefix(f"{file}: ")

    return message
