# SPDX-License-Identifier: GPL-3.0-or-later
"""manifest.parquet: a row for every frame of a packed dataset."""

from collections.abc import Sequence as Many
from typing import Any

from ..core.channels import CHANNELS
from ..core.datasets.layouts import Modality
from ..core.datasets.provenance import CONVENTIONS
from ..core.requirements import missing_packages
from .finished import Content, FrameImages
from .packed_names import tar_name
from .refusals import missing
from .sequence_tar import FrameSpans, perturbed_text
from .store import Store
from .tar_stream import Sink


def table_columns(modalities: Many[Modality]) -> dict[str, tuple[str, str]]:
    """Return the columns by name: the type, as pyarrow calls it, and what it means. pose: 16 numbers, 4 x 4 by rows."""
    columns = {
        "setting": ("string", "the setting: what was done to the sequence"),
        "scene": ("string", "the scene"),
        "frame": ("int32", "the frame's number in its sequence"),
        "time_s": ("float64", "when its colour was taken, seconds"),
        "depth_time_s": ("float64", "when its depth was taken, seconds"),
        "c2w": ("pose", f"the colour camera's pose, 4 x 4 row by row; {CONVENTIONS['pose']}"),
        "perturbed": ("string", "what was done to the frame, as JSON"),
        "tar": ("string", "the tar that holds the frame"),
        "json_offset": ("int64", "where the frame's JSON begins in the tar, bytes"),
        "json_size": ("int64", "the size of the frame's JSON, bytes"),
    }
    for modality in modalities:
        what = CHANNELS[modality].spoken
        columns |= {
            f"{modality}_file": ("string", f"the {what} image's name in the layout, inside the sequence's folder"),
            f"{modality}_sha256": ("string", f"SHA-256 of the {what} image"),
            f"{modality}_offset": ("int64", f"where the {what} image begins in the tar, bytes"),
            f"{modality}_size": ("int64", f"the size of the {what} image, bytes"),
        }
    return columns


def need_writer(store: Store) -> None:
    """Raise MissingDependencyError where the package that writes the table is missing: before anything is made."""
    if missing_packages(["pyarrow"]):
        raise missing(store.text, "pyarrow")


class FrameTable:
    """The table while it is written; memory holds a sequence of it. made_with: the version of what writes it."""

    def __init__(self, sink: Sink, content: Content) -> None:
        import pyarrow
        import pyarrow.parquet

        self._content = content
        self._pyarrow = pyarrow
        types = {"pose": pyarrow.list_(pyarrow.float64(), 16)}
        fields = [
            pyarrow.field(name, types.get(kind) or pyarrow.type_for_alias(kind), nullable=False)
            for name, (kind, _) in table_columns(content.modalities).items()
        ]
        self.made_with = f"pyarrow {pyarrow.__version__}"
        versions = {"noisy_world": content.identity["versions"]["noisy_world"], "pyarrow": pyarrow.__version__}
        self._schema = pyarrow.schema(fields, metadata=versions)
        self._writer: Any = pyarrow.parquet.ParquetWriter(
            pyarrow.PythonFile(_Writable(sink), mode="w"), self._schema, compression="zstd"
        )

    def add(self, sequence: str, frames: list[FrameImages], spans: list[FrameSpans]) -> None:
        """Write the rows of a sequence."""
        setting, scene = sequence.split("/")
        rows: dict[str, list[Any]] = {
            "setting": [setting] * len(frames),
            "scene": [scene] * len(frames),
            "frame": [frame.number for frame in frames],
            "time_s": [frame.record.time_s for frame in frames],
            "depth_time_s": [frame.depth_time_s for frame in frames],
            "c2w": [frame.c2w.ravel().tolist() for frame in frames],
            "perturbed": [perturbed_text(frame) for frame in frames],
            "tar": [tar_name(sequence)] * len(frames),
            "json_offset": [span.json.offset for span in spans],
            "json_size": [span.json.size for span in spans],
        }
        for modality in self._content.modalities:
            rows[f"{modality}_file"] = [frame.images[modality][0] for frame in frames]
            rows[f"{modality}_sha256"] = [frame.images[modality][1] for frame in frames]
            rows[f"{modality}_offset"] = [span.images[modality].offset for span in spans]
            rows[f"{modality}_size"] = [span.images[modality].size for span in spans]
        self._writer.write_table(self._pyarrow.table(rows, schema=self._schema))

    def __enter__(self) -> "FrameTable":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Write the table's end, unless an error ended the writing."""
        if kind is None:
            self._writer.close()
        else:
            self._writer.is_open = False  # or it would be written when it is collected


class _Writable:
    """What pyarrow asks of a file that it writes."""

    closed = False

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self.tell = sink.tell

    def write(self, data: Any) -> int:
        return self._sink.write(bytes(data))

    def flush(self) -> None:
        """Do nothing: what was written is on its way."""

    def close(self) -> None:
        """Leave the sink open; who opened it closes it."""
