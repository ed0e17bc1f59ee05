# SPDX-License-Identifier: GPL-3.0-or-later
"""Which columns of a table hold the poses, told by the names that its header gives, at any width.

So what OpenVINS, RTAB-Map, maplab, `rostopic echo -p` and others write beside a pose (covariances, velocities, numbers,
names of coordinate frames) is passed over.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

StampUnit: TypeAlias = Literal["s", "ms", "us", "ns"]
STAMP_UNITS: tuple[str, ...] = get_args(StampUnit)

HEADER = "# timestamp tx ty tz qx qy qz qw"
"""A header that names the columns of a pose, for messages."""

_LEAST_COMMAS = 7  # of a header that names stamp, position and quaternion
_LEGACY_WIDTHS = (8, 17)  # of TUM's and EuRoC's tables, where position may have other names: it follows the stamp
_OPENVINS_STATE = ["q", "p", "v"]
_COLMAP = "image_id"  # whose lines are no table: every other one is of points
_ROSTOPIC = "field_"

_UNITS: dict[str, StampUnit] = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "ms": "ms", "msec": "ms", "milliseconds": "ms",
    "us": "us", "usec": "us", "microseconds": "us", "ns": "ns", "nsec": "ns", "nsecs": "ns", "nanoseconds": "ns",
}  # fmt: skip
_TIME = re.compile(r"(?:.*_)?(?:t|ts|time|stamp|time_?stamps?)(?:_(?P<unit>[a-z]+))?")
_POSITION = re.compile(
    r"(?:(?:.*_)?(?:pos|position|trans|translation|location)_?|[pt](?:_[a-z]{1,3}){0,2}_?)?(?P<axis>[xyz])"
)
_QUATERNION = re.compile(
    r"(?P<of>(?:.*_)?(?:quat|quaternion|rot|rotation|orientation)_?|[qro](?:_[a-z]{1,3}){0,2}_?)(?P<axis>[wxyz])"
)


@dataclass(frozen=True)
class PoseColumns:
    """Where a line has stamp, position (x, y, z) and quaternion (w, x, y, z), 0 the first.

    unit: of the stamps, where the header says it. names: how many columns the header names, 0 for any. others: whether
    it names more quaternions, which are not read.
    """

    stamp: int
    position: tuple[int, ...]
    quat_wxyz: tuple[int, ...]
    unit: StampUnit | None = None
    names: int = 0
    others: bool = False

    @property
    def w_first(self) -> bool:
        """Whether w stands before x, as in EuRoC's tables."""
        return self.quat_wxyz[0] < self.quat_wxyz[1]

    @property
    def used(self) -> tuple[int, ...]:
        """The columns, in the order t, x, y, z, qw, qx, qy, qz."""
        return (self.stamp, *self.position, *self.quat_wxyz)


TUM_COLUMNS = PoseColumns(0, (1, 2, 3), (7, 4, 5, 6))
EUROC_COLUMNS = PoseColumns(0, (1, 2, 3), (4, 5, 6, 7))
# ov_msckf's state_estimate.txt: stamp, q_GtoI, p_IinG, ... (ROSVisualizerHelper.cpp). JPL's q of G to I, x y z w, has
# the numbers of Hamilton's q of I to G.
_OPENVINS_COLUMNS = PoseColumns(0, (5, 6, 7), (4, 1, 2, 3), "s")


def named_columns(headers: Sequence[str]) -> PoseColumns | None:
    """Return the columns that the last header with a pose's names gives; None where no header names one."""
    candidates = (_columns_of(_column_names(header)) for header in reversed(headers))
    return next((columns for columns in candidates if columns is not None), None)


def names_columns(header: str) -> bool:
    """Tell whether a line without a number names the columns of a table of poses."""
    return max(header.count(","), header.count(";")) >= _LEAST_COMMAS or named_columns([header]) is not None


def split_cells(line: str) -> list[str]:
    """Return the cells of a line: separated by semicolons where there are some, else by commas, else by blanks."""
    if ";" not in line and "," not in line:
        return line.split()
    cells = [cell.strip() for cell in line.split(";" if ";" in line else ",")]
    if len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _column_names(header: str) -> list[str]:
    """Return a header's names in small letters, with underscores, units among them: timestamp_ns, q_rs_w."""
    cells = split_cells(re.sub(r"(?<!\s)\s++([\[(])", r"\1", header.strip().lstrip("#")))
    return [re.sub(r"[^a-z0-9]+", "_", cell.lower()).strip("_") for cell in cells]


def _columns_of(names: list[str]) -> PoseColumns | None:
    if names[1:4] == _OPENVINS_STATE:
        return _OPENVINS_COLUMNS
    quaternions = _quaternions(names)
    if not quaternions or _COLMAP in names:
        return None
    quat = next(iter(quaternions.values()))
    times = [index for index, name in enumerate(names) if _TIME.fullmatch(name)]
    rostopic = any(name.startswith(_ROSTOPIC) for name in names)
    stamp = next((index for index in times if rostopic and names[index].endswith("header_stamp")), None)
    stamp = stamp if stamp is not None else times[0] if times else 0
    taken = {index for axes in quaternions.values() for index in axes.values()}
    rest = [index for index in range(len(names)) if index not in taken and index != stamp]
    at = {match["axis"]: index for index in reversed(rest) if (match := _POSITION.fullmatch(_bare(names[index])))}
    if set(at) == set("xyz"):
        position = tuple(at[axis] for axis in "xyz")
    elif len(names) in _LEGACY_WIDTHS:
        position = tuple(rest[:3])
    else:
        return None
    match = _TIME.fullmatch(names[stamp])
    unit = "ns" if rostopic else _UNITS.get(match["unit"] or "") if match else None
    return PoseColumns(stamp, position, tuple(quat[axis] for axis in "wxyz"), unit, len(names), len(quaternions) > 1)


def _quaternions(names: list[str]) -> dict[str, dict[str, int]]:
    """Return by their names without the axis the quaternions of which all four parts are named, in their order."""
    quaternions: dict[str, dict[str, int]] = {}
    for index, name in enumerate(names):
        if match := _QUATERNION.fullmatch(_bare(name)):
            axes = quaternions.setdefault(match["of"], {})
            if match["axis"] in axes:  # a header that was cut and joined, say
                return {}
            axes[match["axis"]] = index
    return {of: axes for of, axes in quaternions.items() if len(axes) == 4}


def _bare(name: str) -> str:
    """Return a name without the unit of a length."""
    return name.removesuffix("_m")
