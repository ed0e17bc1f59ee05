# SPDX-License-Identifier: GPL-3.0-or-later
"""The areas of mutated inputs, and one case of them: an input is written, read, and judged."""

import shutil
import sys
import traceback
import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from fuzz import bags, datasets, definitions, jpegs, meshes, poses, presets, recordings, results, videos
from fuzz.limits import Meter, watched
from fuzz.structure import is_sound

from noisy_world.core.errors import NoisyWorldError

Kind = Literal["accepted", "refused", "finding"]


def _nothing(_folder, _meaning):
    """Say nothing: what a changed input means, no other reader tells."""
    return ""


@dataclass(frozen=True)
class Area:
    """Inputs of one kind.

    write: writes a mutated input into an empty folder. read: reads it as the project does, and raises NoisyWorldError
    where it is refused. differs: how what was read differs from what an independent reader finds, "" where it does not.
    """

    write: Callable[[Path, np.random.Generator], None]
    read: Callable[[Path], Any]
    differs: Callable[[Path, Any], str] = _nothing


# Of the first six, bytes and words are changed; of the others, the structure.
AREAS = {
    "presets": Area(presets.write, presets.read, presets.differs),
    "trajectories": Area(poses.write, poses.read, poses.differs),
    "recordings": Area(recordings.write, recordings.read, recordings.differs),
    "videos": Area(videos.write, videos.read, videos.differs),
    "meshes": Area(meshes.write, meshes.read, meshes.differs),
    "datasets": Area(datasets.write_folder, datasets.take_up, datasets.taken_up_differs),
    "shaped_presets": Area(presets.write_shaped, presets.read, presets.differs),
    "mesh_headers": Area(meshes.write_header, meshes.read_header),
    "recording_files": Area(recordings.write_files, recordings.read, recordings.differs),
    "dataset_records": Area(datasets.write, datasets.read, datasets.differs),
    "recipes": Area(datasets.write_recipe, datasets.read, datasets.differs),
    "estimates": Area(poses.write_estimate, poses.read_estimate, poses.estimate_differs),
    "definitions": Area(definitions.write, definitions.read, definitions.differs),
    "results": Area(results.write, results.read),
    "jpegs": Area(jpegs.write, jpegs.read, jpegs.differs),
    "bags": Area(bags.write, bags.read, bags.differs),
}
OF_BLENDER = {"imported_meshes": Area(meshes.write_imported, meshes.read_imported)}
"""Areas that take Blender."""
_ALL = AREAS | OF_BLENDER


@dataclass(frozen=True)
class Outcome:
    """How a case ended. told: the message that refused it, or what was found."""

    kind: Kind
    told: str = ""


def generator(area, seed, number):
    """Return the random numbers of a case."""
    return np.random.default_rng([seed, zlib.crc32(area.encode()), number])


def write_case(area, seed, number, folder):
    """Write the input of a case into a folder, which is emptied first."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    _ALL[area].write(folder, generator(area, seed, number))


def run_case(area, seed, number, folder):
    """Write an input into a folder, read it and judge what came of it.

    It has to be accepted with the meaning that an independent
    reader finds, or refused by a NoisyWorldError of one line that names a file of the folder; without warnings, within
    the limits of time and memory, and without a change outside of its folder. What was not changed is accepted.
    """
    write_case(area, seed, number, folder)
    return judge(area, folder)


def judge(area, folder):
    """Read the input in a folder and judge what came of it."""
    meter = Meter()
    with warnings.catch_warnings(record=True) as warned, watched(folder) as outside:
        warnings.simplefilter("always")
        try:
            meaning = _ALL[area].read(folder)
        except NoisyWorldError as error:
            outcome = _judge_refusal(str(error), folder)
        except Exception:  # noqa: BLE001 - what is looked for
            outcome = Outcome("finding", f"traceback: {_last_traceback()}")
        else:
            outcome = Outcome("accepted")
    if outcome.kind == "refused" and is_sound(folder):
        return Outcome("finding", f"a sound input is refused: {outcome.told}")
    if outcome.kind != "finding" and outside:
        return Outcome("finding", f"outside of its folder: {', '.join(outside[:3])}")
    if outcome.kind != "finding" and (told := meter.told()):
        return Outcome("finding", told)
    if outcome.kind != "finding" and warned:
        first = warned[0]
        return Outcome(
            "finding", f"warning: {first.category.__name__}: {first.message} ({first.filename}:{first.lineno})"
        )
    if outcome.kind == "accepted":
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                told = _ALL[area].differs(folder, meaning)
            except Exception:  # noqa: BLE001 - the independent reader refuses what was accepted
                told = _last_traceback()
        if told:
            return Outcome("finding", f"meaning: {told}")
    return outcome


def _judge_refusal(message, folder):
    if not message.isprintable():
        return Outcome("finding", f"not one line: {message!r}")
    if str(folder) not in message and not message.startswith("/"):  # a list of images may name others
        return Outcome("finding", f"names no file: {message}")
    return Outcome("refused", message)


def _last_traceback():
    kind, error, trace = sys.exc_info()
    frames = [item for item in traceback.extract_tb(trace) if "/fuzz/" not in item.filename]
    at = f" ({frames[-1].filename.rpartition('/')[2]}:{frames[-1].lineno})" if frames else ""
    ours = next((item for item in reversed(frames) if "noisy_world" in item.filename), None)
    at += f" from {ours.filename.rpartition('/')[2]}:{ours.lineno}" if ours is not None else ""
    return f"{kind.__name__}: {str(error)[:300]}{at}"
