# SPDX-License-Identifier: GPL-3.0-or-later
"""A finished dataset of recordings in a folder, made once, and the same packed."""

import pytest

pytest.importorskip("fsspec", reason="the extra 'cloud' is not installed: fsspec")
pytest.importorskip("pyarrow", reason="the extra 'cloud' is not installed: pyarrow")


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """Make the dataset of packed.SETTINGS of two recordings."""
    from many_settings import run
    from packed import write_preset

    folder = tmp_path_factory.mktemp("recorded")
    run(write_preset(folder), folder / "out")
    return folder / "out"


@pytest.fixture(scope="session")
def packed(dataset, tmp_path_factory):
    """Pack the dataset in a folder."""
    from packed import pack_to

    folder = tmp_path_factory.mktemp("packed") / "noisy"
    assert pack_to(dataset, f"file://{folder}").new
    return folder
