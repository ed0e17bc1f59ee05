# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a run's dataset goes: a folder, in which frames lie where they are made."""

import contextlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event
from typing import Any, TypeAlias

from ..core.datasets.dataset import Dataset
from ..core.datasets.dataset_state import RUN
from ..core.datasets.differences import why_not
from ..core.datasets.shard_merging import ShardRules, drop_unfinished, merge_shard, merged_shards
from ..core.datasets.shard_record import shard_folder
from ..core.errors import StorageError
from ..core.messages import Action, Message, either
from ..core.planning.estimate import image_bytes, size_text
from ..core.planning.plan import Plan, Render
from ..core.planning.shards import Shard, shards_of
from ..core.progress import Progress
from .completed_images import CompletedImages, keep_intact
from .report import Report
from .shard import ShardMaker

SHARDS_PER_JOB = 8  # chosen: the last shard of a run is a sixteenth of a job's work on average, so none waits long

Work: TypeAlias = dict[str, list[int]]
"""The source frames to render, by the name of the render."""

Made: TypeAlias = Callable[[Shard], None]
"""What is called with each shard that is finished."""


class Destination:
    """A folder as where a dataset goes; other places differ from it.

    dataset: is written to while it is open. looking: what is said while it is asked what is there.
    merged_by_workers: whether those who make shards merge them.
    """

    looking = "checking the frames that are there"
    merged_by_workers = True

    def __init__(self, plan: Plan, folder: Path) -> None:
        """Take a plan and the dataset's folder, which `open` makes."""
        self._plan = plan
        self.folder = folder
        self.dataset = Dataset(folder, plan.format)

    def __str__(self) -> str:
        """Return the place for messages."""
        return str(self.folder)

    @property
    def _any_processor(self) -> bool:
        return self._plan.preset.spec.render.processors == "any"

    def open(self, identity: dict[str, Any], *, overwrite: bool, unfinished: bool) -> bool:
        """Take the place for a run that makes what an identity says; False where nothing of it is to be made.

        unfinished: as of `ShardRules`. Raises StorageError where something else is there, BusyError where another run
        is at it.
        """
        rules = ShardRules(unfinished=unfinished, any_processor=self._any_processor)

        def problem(there: dict[str, Any]) -> str | None:
            return why_not(there, identity, self._plan)

        self.dataset.open(identity, problem, overwrite=overwrite, shards=rules)
        return True

    def completed(self, render: Render) -> CompletedImages:
        """Return the images of a render that are there; here every file is hashed."""
        names = self._plan.format.names(render.scene.source.frame_stamps)
        for sequence in render.sequences:
            keep_intact(self.dataset, sequence, names)
        return CompletedImages(self.dataset, render)

    def cut(self, work: Work, needed_bytes: int, count: int | None, jobs: int) -> tuple[Shard, ...] | None:
        """Return the shards in which frames are made; None where they go straight into the dataset.

        needed_bytes: roughly what is to be written. count: about how many shards several processes are to make, None
        for one process. jobs: how many processes. Raises StorageError where there is no room.
        """
        del jobs
        self._check_space(needed_bytes)
        return None if count is None or not work else shards_of(self._plan, count, work)

    def _check_space(self, needed_bytes: int) -> None:
        """Note where the disk is too small; raise StorageError where not even a frame fits. The sizes are rough."""
        free_bytes = shutil.disk_usage(self.folder).free
        if needed_bytes <= free_bytes:
            return
        message = f"about {size_text(needed_bytes)} are to be written and {size_text(free_bytes)} are free"
        render = self._plan.renders[0]
        frame_bytes = sum(image_bytes(self._plan, render, modality) for modality in self._plan.format.modalities)
        if free_bytes < min(needed_bytes, frame_bytes):
            remedy = either(Message("make room there and ", Action.RUN_AGAIN), Action.OTHER_FOLDER)
            raise StorageError(f"no space left: {message}", file=self.folder, remedy=remedy)
        fits = "this will hardly fit"
        self.dataset.notes.append(f"{fits}: {message} in {self}; a run that fills the disk goes on once there is room")

    @contextlib.contextmanager
    def making(
        self,
        progress: Progress,
        stop: Event,
        *,
        threads: int = 0,
        overwrite: bool = False,
        joining: bool = False,
        merging: bool = False,
    ) -> Iterator[Callable[[Shard], Report]]:
        """Return what makes shards, for whoever runs beside the run that takes them in; see `ShardMaker.make`.

        merging: whether each is merged at once, by this process: one for all of a cluster could not keep up.
        """
        with ShardMaker(self._plan, progress=progress, stop=stop, threads=threads) as maker:

            def make(shard: Shard) -> Report:
                folder = shard_folder(self.folder, shard)
                if not joining:
                    maker.check_dataset(self.dataset, shard, folder)
                report = maker.make(folder, shard, self.dataset, joining=joining, overwrite=overwrite)
                if merging:
                    self._merge(folder)
                return report

            yield make

    def _merge(self, folder: Path) -> None:
        """Merge a finished shard. Raises StorageError where a file is damaged already."""
        if damaged := merge_shard(self.dataset, folder).damaged:
            where = f"{self.folder / damaged[0]}"
            raise StorageError("is not as it was written", file=where, remedy="look after the disk, and run it again")

    @contextlib.contextmanager
    def taking(self) -> Iterator[Made]:
        """Take in shards while others are made; all are in at the end of the block. Here, who makes one merges it."""

        def made(shard: Shard) -> None:
            del shard

        yield made

    def merged(self) -> list[dict[str, Any]]:
        """Return the summaries of the shards that the dataset was made from."""
        return merged_shards(self.folder)

    def drop_unfinished(self) -> None:
        """Remove shards that are unfinished, where nothing is missing."""
        if self._plan.chosen is None:
            drop_unfinished(self.dataset.shards_left)

    def fetch_pictured(self) -> None:
        """Have the images in the dataset's folder that its contact sheet shows."""

    def seal(self, run_text: Callable[[], str], progress: Progress, stop: Event) -> None:
        """End the dataset, whose manifest is written. run_text: returns run.json."""
        del progress, stop
        self.dataset.write_text(RUN, run_text())
        self.dataset.seal()

    def close(self) -> None:
        """Let go of the place."""
        self.dataset.close()
