# SPDX-License-Identifier: GPL-3.0-or-later
"""A finished dataset of recordings in a folder, made once, and the same packed."""

import pytest

pytest.importorskip("fsspec", reason="the extra 'cloud' is not installed: fsspec")
pytest.importorskip("pyarrow", reason="the extra 'cloud' is not installed: pyarrow")


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """Make the dataset of packed.SETTINGS of two recordings."""
    from runs import run
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


@pytest.fixture(scope="session")
def store_server():
    pytest.importorskip("moto", reason="moto is not installed")
    pytest.importorskip("s3fs", reason="the extra 'cloud' is not installed: s3fs")
    from object_store import ObjectStore

    store = ObjectStore()
    yield store
    store.stop()


@pytest.fixture
def store(store_server, monkeypatch):
    """An object store, to which s3:// leads."""
    for name, value in store_server.environment.items():
        monkeypatch.setenv(name, value)
    return store_server
