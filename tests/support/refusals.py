# SPDX-License-Identifier: GPL-3.0-or-later
"""The one line with which a user's file is refused."""

import pytest

from noisy_world.core.errors import InputError


def refusal(read, path, *, named=None, error=InputError):
    """What `read` says of the file that it refuses, without the file's own name in front.

    named: the file or address that the line names; the same by default.
    """
    with pytest.raises(error) as caught:
        read(path)
    said = str(caught.value)
    assert said.isprintable()  # one line, and no control characters of a stranger's file
    front = f"{path if named is None else named}: "
    assert said.startswith(front)
    return said.removeprefix(front)


def refused(call, *arguments, names, error=InputError, **options):
    """The one line with which `call(*arguments, **options)` is refused.

    names: what it has to hold of the file, the key and the remedy; one text, or several.
    """
    with pytest.raises(error) as caught:
        call(*arguments, **options)
    said = str(caught.value).strip()  # Blender ends the line of an operator
    assert said.isprintable(), said
    for name in [names] if isinstance(names, str) else names:
        assert name in said, f"{name!r} is not in: {said}"
    return said
