# SPDX-License-Identifier: GPL-3.0-or-later
"""The report's templates: HTML escapes by itself; Markdown and LaTeX by the filters of their names."""

import base64
from functools import cache
from typing import TYPE_CHECKING

from ...core.shipped import PACKAGE
from .escaping import latex, markdown

if TYPE_CHECKING:
    from jinja2 import Environment

FOLDER = PACKAGE / "evaluate" / "templates"


@cache
def environment() -> "Environment":
    """Return the environment of the templates in FOLDER; a name that a template is not given is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

    made = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=select_autoescape(("html.j2",)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters["markdown"] = markdown
    made.filters["latex"] = latex
    made.filters["base64"] = lambda data: base64.b64encode(data).decode("ascii")
    return made
