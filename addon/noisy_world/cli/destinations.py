# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a command's dataset goes: the folder or the address that its options name."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .arguments import out_address, out_folder

if TYPE_CHECKING:
    from ..core.planning.plan import Plan
    from ..pipeline.destination import Destination


def destination_of(
    plan: "Plan", options: argparse.Namespace, *, folder: Path | None = None, put_by_workers: bool = False
) -> "Destination":
    """Return where a plan's dataset goes. folder: where, if not where the options say.

    put_by_workers: whether workers on other machines put shards to an address themselves. Raises InputError where
    frames have no pose, which a packed dataset's table has for each, StorageError where an address is to be overwritten
    or has no meaning.
    """
    from ..pipeline.destination import Destination

    address = out_address(options)
    if folder is not None or address is None:
        return Destination(plan, folder or out_folder(options))
    from ..core.errors import StorageError
    from ..pipeline.address_destination import AddressDestination
    from ..storage.open_store import open_store

    if vars(options).get("overwrite"):
        remedy = "choose another address with --out, or remove a shard's .json there"
        raise StorageError(f"--overwrite replaces datasets and shards in folders; {remedy}")
    for scene in plan.scenes:
        if not (scene.source.capabilities.any_pose or scene.path.known.all()):
            message = "frames without a pose cannot be at an address, whose table of frames has one for each"
            raise scene.place.error(message, "write the dataset into a folder")
    return AddressDestination(plan, open_store(address), options.scratch, put_by_workers=put_by_workers)
