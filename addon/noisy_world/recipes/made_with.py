# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares versions and processor with a recipe's; bytes are equal only where these are."""

from collections.abc import Mapping
from typing import Any

from ..core.datasets.differences import was_is
from ..core.datasets.provenance import HUFFMAN, base_versions, processor
from ..core.errors import one_line

BOUND = "pixels may differ by 1/255, and by more where noise falls on the other side of a threshold"
TABLES = "noisy JPEG images have other Huffman tables than the recipe's, for the same pixels"


def made_otherwise(recipe: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return in a line what makes other bytes than a recipe's, "" where nothing does.

    recipe, here: identities. Versions of what only one of them needs do not count.
    """
    versions = {
        name: (recipe["versions"].get(name, "none"), version)
        for name, version in here["versions"].items()
        # Python itself decides no byte; deflate does since it compresses PNG files.
        if name != "python" and recipe["versions"].get(name, version if name != "deflate" else None) != version
    }
    parts = [f"{name} {was_is(*pair)}" for name, pair in versions.items()]
    if other := _processor(recipe["processor"], here["processor"]):
        parts.append(other)
    return one_line(f"made with others than the recipe: {'; '.join(parts)}: {BOUND}") if parts else ""


def written_otherwise(recipe: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return in a line what makes other files of a dataset than a recipe's, "" where nothing does. Both: identities."""
    found = made_otherwise(recipe, here)
    if here["output"].get(HUFFMAN) == recipe["output"].get(HUFFMAN):
        return found
    return "; ".join([*([found] if found else []), TABLES])


def _processor(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    if there == here:
        return ""
    for key in ("machine", "byte_order"):
        if there[key] != here[key]:
            return f"processor {was_is(there[key], here[key])}"
    lacks, more = sorted({*there["features"]} - {*here["features"]}), sorted({*here["features"]} - {*there["features"]})
    lines = [f"{word} {', '.join(names)}" for word, names in (("without", lacks), ("with", more)) if names]
    return f"a processor {' and '.join(lines)}"


def made_here() -> dict[str, Any]:
    """Return what this process would make frames with, apart from what renders them, as an identity has it."""
    return {"versions": base_versions(), "processor": processor()}
