# SPDX-License-Identifier: GPL-3.0-or-later
"""The errors that a user can cause and mend.

On the command line each becomes a single line and a non-zero exit status, in the add-on a report in the status bar. Any
other exception is a bug and keeps its traceback.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .messages import Message, Part, Remedy, Subject, either


class NoisyWorldError(Exception):
    """What went wrong, where, and what to do about it, in one line: `FILE: WHERE: PROBLEM; REMEDY`.

    message: the line in its parts, for a place that has words of its own for keys and remedies.
    """

    def __init__(self, problem: str, *, file: object = "", where: str = "", remedy: Part = "") -> None:
        self.file, self.where, self.problem = str(file), where, problem
        self.remedy = remedy if isinstance(remedy, Remedy) else either(remedy)
        about = (Subject(self.file, where),) if self.file else ()
        self.message = Message(*map(_in_one_line, Message(*about, problem, self.remedy).parts))
        super().__init__(one_line(self.message))


def _in_one_line(part: Part) -> Part:
    match part:
        case str():
            return one_line(part)
        case Subject(file, where):
            return Subject(one_line(file), one_line(where))
        case _:
            return part


def one_line(text: str) -> str:
    """Return a text with what a line cannot show as Python's escapes: line ends, bytes of names that are not UTF-8."""
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else _escaped(letter) for letter in text)


def _escaped(letter: str) -> str:
    """Return the escape of a letter; of a byte that stands as half a surrogate pair, as Python reads names, its own."""
    byte = ord(letter) - 0xDC00
    return f"\\x{byte:02x}" if 0x80 <= byte <= 0xFF else ascii(letter)[1:-1]


class InputError(NoisyWorldError):
    """A file that the user gave is not what it should be. where: a key of a preset, or a line of a text file."""

    def __init__(self, file: str | Path, problem: str, *, where: str = "", remedy: Part = "") -> None:
        super().__init__(problem, file=file, where=where, remedy=remedy)


class NotFiniteError(InputError):
    """A file of poses can be read, but holds NaN or infinity where a pose has to be."""


class MissingDependencyError(NoisyWorldError):
    """A library that is needed is not installed; the message gives the command that installs it."""


class StorageError(NoisyWorldError):
    """The dataset cannot be written or continued in its folder: disk full, no permission, or another run's data."""


class BusyError(StorageError):
    """Another process is writing there."""


class CannotJoinError(StorageError):
    """This process does not see the run that it is to take part in, or would make other bytes."""


class OutOfMemoryError(NoisyWorldError):
    """This process got no more memory."""


@contextmanager
def memory_errors() -> Iterator[None]:
    """Turn want of memory, numpy's, OpenCV's and that of threads, into one line. Raises OutOfMemoryError."""
    try:
        yield
    except Exception as error:
        if not (isinstance(error, MemoryError) or _is_opencvs(error) or str(error) == _NO_THREAD):
            raise
        more = "" if _is_opencvs(error) or not str(error) else f": {error}"
        raise OutOfMemoryError(f"memory is short{more}", remedy=MORE_MEMORY) from error


MORE_MEMORY = either("make the images smaller", "run it where there is more memory")
_OPENCV_NO_MEMORY = -4  # cv2.Error.StsNoMem
_NO_THREAD = "can't start new thread"  # Python's, a RuntimeError, where there is no room for its stack


def _is_opencvs(error: Exception) -> bool:
    return type(error).__module__ == "cv2" and getattr(error, "code", None) == _OPENCV_NO_MEMORY


class InterruptedRunError(NoisyWorldError):
    """The user stopped the run; the message says how to continue it."""
