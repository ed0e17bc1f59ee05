# SPDX-License-Identifier: GPL-3.0-or-later
"""Protocols: what is decided before a number is calculated, said by name.

`strict` is ours. `paper` does what the published code of the paper does, faults included, as nothing that was published
can be compared otherwise.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from ..association import MAX_DIFFERENCE_S
from .alignment import Alignment

Kind: TypeAlias = Literal["strict", "paper"]

DEFINITIONS = 2
"""Raised when equal estimates get other values. Results of before are read, but take no runs of these.

1: pairs within 0.02 s, coverage in samples of the truth, rotations and maps laid by positions alone.
"""


@dataclass(frozen=True)
class Protocol:
    """How a run is scored.

    kind: which values it gives. rgbd, monocular: the alignment of a system with depth, and of one without.
    statistic: of ate_m, of kind paper. keyframes: whether a run's keyframes are scored, where it has them.
    failed: what errors of a failed run are; None: nothing. faults: by name, what is not as one would expect.
    """

    name: str
    meaning: str
    kind: Kind
    rgbd: Alignment
    monocular: Alignment
    statistic: Literal["rmse", "mean"] = "rmse"
    keyframes: bool = False
    failed: float | None = None
    max_difference_s: float = MAX_DIFFERENCE_S
    faults: tuple[tuple[str, str], ...] = ()

    def alignment(self, *, monocular: bool) -> Alignment:
        """Return the alignment of a system."""
        return self.monocular if monocular else self.rgbd


_FAILED_IS_ONE = (
    "failed_is_1",
    "a run without a trajectory, or with fewer than three poses, has ATE and RPE 1.0 and SR 0",
)
_NOT_CAPPED = (
    "errors_not_capped",
    "the ATE of a run that did not fail may exceed 1.0, so it can be worse than a failure",
)
_SCALED = ("sim3_with_depth", "the scale is fitted although depth tells it, which hides an error of scale")
_KEYFRAMES = ("keyframes_only", "only keyframes are compared, so frames between them and lost frames cost nothing")
_RPE = ("rpe_is_rotation", "RPE, printed in metres, is the rotation between consecutive keyframes in radians")
_SR = (
    "sr_is_path_share",
    "SR is the length of the aligned keyframes' path over that of the true path; drift raises it",
)
_MEAN = ("mean_not_rmse", "ATE is the mean of the errors, which is never more than the RMSE")

PROTOCOLS: dict[str, Protocol] = {
    protocol.name: protocol
    for protocol in (
        Protocol(
            "strict",
            "SE(3) with depth and Sim(3) without, all frames, RMSE; a failed run has no error, and coverage is said",
            "strict",
            Alignment.SE3,
            Alignment.SIM3,
        ),
        Protocol(
            "paper",
            "as the paper's code does it for ORB-SLAM3: Sim(3), keyframes, RMSE",
            "paper",
            Alignment.SIM3,
            Alignment.SIM3,
            keyframes=True,
            failed=1.0,
            faults=(_FAILED_IS_ONE, _NOT_CAPPED, _SCALED, _KEYFRAMES, _RPE, _SR),
        ),
        Protocol(
            "paper_go_slam",
            "as the paper's code does it for GO-SLAM: Sim(3), all frames, RMSE",
            "paper",
            Alignment.SIM3,
            Alignment.SIM3,
            failed=1.0,
            faults=(_FAILED_IS_ONE, _NOT_CAPPED, _SCALED, _RPE, _SR),
        ),
        Protocol(
            "paper_mean",
            "as the paper's code does it for iMAP, NICE-SLAM, Co-SLAM and SplaTAM: SE(3), all frames, mean",
            "paper",
            Alignment.SE3,
            Alignment.SE3,
            statistic="mean",
            failed=1.0,
            faults=(_FAILED_IS_ONE, _NOT_CAPPED, _MEAN, _RPE, _SR),
        ),
    )
}
"""Every protocol by name. The paper prints RPE and SR of ORB-SLAM3 alone; of others they are by the same formulas."""


_MEAN_SYSTEMS = ("imap", "nice_slam", "co_slam", "coslam", "splatam")


def paper_protocol(system: str) -> Protocol:
    """Return the protocol by which the paper scores a system of this name: `paper` for one that it does not score."""
    name = system.lower().replace("-", "_")
    if name.startswith("go_slam"):
        return PROTOCOLS["paper_go_slam"]
    return PROTOCOLS["paper_mean" if name.startswith(_MEAN_SYSTEMS) else "paper"]
