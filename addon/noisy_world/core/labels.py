# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of parameters for people: the same in the panel and on node groups' sockets, in Blender's wording."""

import re

UNIT_SUFFIXES = (
    "_px",
    "_deg",
    "_m",
    "_mm",
    "_percent",
    "_hz",
    "_m_s",
    "_mm_h",
    "_mrad",
    "_ms",
    "_per_s",
    "_db",
    "_stops",
    "_s",
)
_SMALL_WORDS = ("by", "of", "to", "and", "on", "in", "the")
_AMERICAN = {
    "colour": "color", "colours": "colors", "coloured": "colored", "grey": "gray", "greys": "grays",
    "centre": "center", "centres": "centers", "metre": "meter", "metres": "meters", "neighbour": "neighbor",
    "neighbours": "neighbors", "synchronisation": "synchronization", "desynchronisation": "desynchronization",
    "quantised": "quantized", "normalised": "normalized", "optimised": "optimized", "recognised": "recognized",
    "kerb": "curb", "licence": "license", "behaviour": "behavior", "favour": "favor", "minimise": "minimize",
}  # fmt: skip
# Not inside the name of a file: after or before a slash, a dot, a dash or an underscore.
_WORD = re.compile(rf"(?<![\w/\\.-])({'|'.join(_AMERICAN)})(?![\w/\\-]|\.\w)", re.IGNORECASE)


def title(text: str) -> str:
    """Return a label as Blender writes them: "fog by depth" -> "Fog by Depth"."""
    words = text.replace("_", " ").split()
    return american(
        " ".join(
            word if (place and word in _SMALL_WORDS) or not word[0].islower() else word[0].upper() + word[1:]
            for place, word in enumerate(words)
        )
    )


def parameter_label(name: str) -> str:
    """Return a parameter's name in words, without its unit, which the slider shows."""
    for suffix in UNIT_SUFFIXES:
        name = name.removesuffix(suffix)
    return title(name)


def american(text: str) -> str:
    """Return a text in the spelling of Blender's interface; names of files in it stay as they are."""

    def spelt(match: re.Match[str]) -> str:
        word = match.group()
        other = _AMERICAN[word.lower()]
        return other.upper() if word.isupper() else other.capitalize() if word[0].isupper() else other

    return _WORD.sub(spelt, text)
