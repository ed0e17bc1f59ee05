# SPDX-License-Identifier: GPL-3.0-or-later
"""What the commands do where the dataset is at an address."""

import argparse
import threading
from typing import TYPE_CHECKING

from .arguments import out_address

if TYPE_CHECKING:
    from ..core.planning.plan import Plan
    from ..core.progress import Progress
    from ..pipeline.address_run import AddressRun
    from ..pipeline.report import Report


def run_at(
    plan: "Plan", options: argparse.Namespace, progress: "Progress", stop: threading.Event, jobs: int = 1
) -> "AddressRun":
    """Return the run of a plan at the address that the options name.

    Raises InputError where frames have no pose, which a packed dataset's table has for each.
    """
    from ..pipeline.address_run import AddressRun
    from ..storage.address import open_address

    _check_poses(plan)
    text = out_address(options)
    assert text is not None, "the dataset is at an address"
    address = open_address(text)
    return AddressRun(plan, address, progress=progress, stop=stop, scratch=options.scratch, jobs=jobs)


def _check_poses(plan: "Plan") -> None:
    for scene in plan.scenes:
        if not (scene.source.gives.any_pose or scene.source.trajectory().known.all()):
            told = "frames without a pose cannot be at an address, whose table of frames has one for each"
            raise scene.place.error(told, "write the dataset into a folder")


def told_of(report: "Report", options: argparse.Namespace) -> int:
    """Print the outcome; return the exit status."""
    from .outcome import tell_outcome

    print(f"wrote {out_address(options)}")
    tell_outcome(report, options)
    return 0
