# SPDX-License-Identifier: GPL-3.0-or-later
"""The outcome of a run in one line, for people and for programs."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..pipeline.report import Report


def tell_outcome(report: "Report", options: argparse.Namespace) -> None:
    """Print the figures of a run, and send them to a program that listens."""
    from .running import machine_listener

    print(figures(report))
    if options.progress == "json":
        machine_listener().tell({"result": figures(report)})


def figures(report: "Report") -> str:
    """Return the figures of a run in one line."""
    parts = [f"{report.frames_rendered} frames rendered"]
    if report.frames_kept:
        parts.append(f"{report.frames_kept} kept")
    if report.frames_per_s is not None:
        parts.append(f"{report.frames_per_s:.2f} frames/s")
        parts.append(f"loading {report.loading_s:.1f} s")
    if report.rays_per_px is not None:
        parts.append(f"{report.rays_per_px:.2f} rays a pixel")
    if report.decoding_share is not None:
        parts.append(f"decoding {100 * report.decoding_share:.0f} % of the processor's time")
    parts.append(f"{report.total_s:.1f} s in all")
    if report.peak_memory_bytes is not None:
        parts.append(f"peak memory {report.peak_memory_bytes / 1e6:.0f} MB")
    return ", ".join(parts)
