# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashing in threads: the order, links, what cannot be read, and that a file with several names is read once."""

import hashlib
import threading

from noisy_world.core import atomic_files
from noisy_world.core.atomic_files import BATCH, Hasher


def test_digests_come_in_order_and_linked_files_are_read_once(tmp_path, monkeypatch):
    count, read, lock, real = 5 * BATCH + 3, [], threading.Lock(), atomic_files.read_sha256

    def noted(path):
        with lock:
            read.append(path)
        return real(path)

    monkeypatch.setattr(atomic_files, "read_sha256", noted)
    wanted, paths = [], []
    for number in range(count):
        content = b"%d" % number * (number % 7)
        path = tmp_path / f"{number}"
        path.write_bytes(content)
        paths.append(str(path))
        wanted.append(hashlib.sha256(content).hexdigest())
    for number in range(0, count, 5):
        (tmp_path / f"{number}-again").hardlink_to(tmp_path / f"{number}")
        paths.append(f"{tmp_path}/{number}-again")
        wanted.append(wanted[number])
    assert list(Hasher().ahead(paths, threads=3)) == wanted
    assert len(read) == count


def test_what_is_no_file_of_its_own_has_no_digest(tmp_path):
    (tmp_path / "file").write_bytes(b"abc")
    (tmp_path / "link").symlink_to("file")
    (tmp_path / "folder").mkdir()
    paths = [f"{tmp_path}/{name}" for name in ("link", "file", "folder", "missing", "file/below")]
    abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # FIPS 180-4, its first example
    assert list(Hasher(links=False).ahead(paths)) == [None, abc, None, None, None]
    assert list(Hasher().ahead(paths)) == [abc, abc, None, None, None]
    assert list(Hasher().ahead([])) == []


def test_no_more_is_hashed_than_is_asked_for(tmp_path):
    (tmp_path / "file").write_bytes(b"abc")
    asked = []

    def paths():
        for number in range(100 * BATCH):
            asked.append(number)
            yield str(tmp_path / "file")

    digests = Hasher().ahead(paths(), threads=1)
    next(digests)
    digests.close()
    assert len(asked) <= 4 * BATCH
