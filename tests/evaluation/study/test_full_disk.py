# SPDX-License-Identifier: GPL-3.0-or-later
"""A study on a disk that fills: a line, and the same results once there is room; and without room for clean frames."""

import errno
import json
import os
import shutil
from pathlib import Path

import pytest
from study_tools import evaluate, small_world, told, write_systems

pytest.importorskip("embreex", reason="embreex comes with an extra")
pytest.importorskip("tabulate", reason="tabulate comes with an extra")

FRAMES = 4
LITTLE = 100_000  # bytes: clean frames would take more than a quarter
SETTINGS = [
    {"name": "clean"},
    {"name": "noise", "perturb": [{"gaussian_noise": {"severity": 3}}, {"depth_gaussian_noise": {"severity": 2}}]},
    {"name": "rolled", "perturb": [{"rolling_shutter": {"severity": 2}}, {"contrast": {"severity": 2}}]},
]


class Disk:
    """A disk for all files that are written at once: the door of `write_atomic`. said_free: what it says is free."""

    def __init__(self, monkeypatch):
        self._write, self._usage = Path.write_bytes, shutil.disk_usage
        self.of()
        monkeypatch.setattr(Path, "write_bytes", lambda path, data: self.write(path, data))  # noqa: PLW0108 - a method
        monkeypatch.setattr(shutil, "disk_usage", self.usage)

    def of(self, free=10**9, said_free=None, full_at=""):
        """Have so many bytes; be full, too, at the second file whose name ends so."""
        self.free, self.said_free, self.full_at, self.written, self.met = free, said_free, full_at, 0, 0

    def usage(self, path):
        found = self._usage(path)
        return found if self.said_free is None else found._replace(free=self.said_free)

    def write(self, path, data):
        self.written += len(data)
        self.met += bool(self.full_at) and path.name.endswith(self.full_at)
        if self.written > self.free or self.met > 1:
            self._write(path, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self._write(path, data)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("full")
    small_world(folder / "world", frames=FRAMES, settings=SETTINGS)
    write_systems(folder / "systems", "fine", frames=FRAMES)
    return folder


def study(world, out, *more):
    system = world / "systems/fine.yaml"
    return evaluate(world / "world/preset.yaml", "--systems", system, "--jobs", 1, "--out", out, *more)


def results_of(out):
    """Everything in a folder of results but what runs took, those that made the kept datasets among them."""
    return {name: data for name, data in told(out).items() if not (name.startswith("kept/") and "run.json" in name)}


def images(results):
    """What is told of images against clean ones, by setting."""
    keys = ("image_rmse_mean", "ssim_mean", "depth_error_m_mean")
    found = {path.parts[-3]: json.loads(path.read_text()) for path in sorted(results.rglob("indicators.json"))}
    return {setting: [content[key] for key in keys] for setting, content in found.items()}


FULL = [
    {"free": 0.3},
    {"free": 0.9},
    {"full_at": "000000.npy"},
    # Sequences are finished whose clean frames were not kept, and later there is room for those.
    {"full_at": "indicators.json", "said_free": LITTLE},
]


def test_it_goes_on_once_there_is_room(world, tmp_path, monkeypatch, capfd):
    disk = Disk(monkeypatch)
    assert study(world, tmp_path / "whole", "--keep") == 0
    whole, needed = results_of(tmp_path / "whole"), disk.written
    capfd.readouterr()
    for number, full in enumerate(FULL):
        out = tmp_path / f"{number}"
        disk.of(**{key: int(value * needed) if key == "free" else value for key, value in full.items()})
        assert study(world, out, "--keep") == 1
        said = capfd.readouterr().err
        assert "no space left" in said.splitlines()[-1]
        assert "Traceback" not in said
        disk.of()
        assert study(world, out, "--keep") == 0, capfd.readouterr().err
        assert results_of(out) == whole, full


def test_two_machines_give_one_table(world, tmp_path, monkeypatch):
    """With room for clean frames, and without."""
    assert study(world, tmp_path / "kept") == 0
    Disk(monkeypatch).of(said_free=LITTLE)
    assert study(world, tmp_path / "anew") == 0
    assert told(tmp_path / "anew") == told(tmp_path / "kept")
    found = images(tmp_path / "anew")
    assert found.pop("clean") == [None, None, None]
    assert {setting for setting, values in found.items() if None not in values} == {"noise", "rolled"}
