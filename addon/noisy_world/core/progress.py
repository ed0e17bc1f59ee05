# SPDX-License-Identifier: GPL-3.0-or-later
"""Reporting progress to a terminal, a log, a Blender window or a test."""

import json
import time
from collections.abc import Callable
from typing import Any, Protocol, TextIO

from .errors import Message, from_content, to_content

# Begins each message to another process, which tells messages from other output on the stream, such as Blender's.
MARK = "@noisy-world "
KNOWN_FRAMES, KNOWN_S = 3, 3.0  # after the first report, before a pace is believed; chosen


class Progress(Protocol):
    """A listener. Calls come from one thread."""

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Begin a task of `total` frames, of which `done` exist already."""

    def advance(self, count: int = 1) -> None:
        """Report that `count` more frames are done."""

    def note(self, text: str, subject: str = "") -> None:
        """Show the user a sentence. subject: several processes may have one to say on it, and one is enough; "" if not.

        Only a listener to several processes looks at the subject.
        """

    def finish(self) -> None:
        """End the task."""


class SilentProgress(Progress):
    """A listener that shows nothing."""


def duration_text(seconds: float) -> str:
    """Return a time in seconds, minutes or hours, as text."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 100 else f"{minutes / 60:.1f} h"


def counted(number: int, name: str) -> str:
    """Return a number of things in words: 1 frame, 1,200 frames."""
    return f"{number:,} {name}{'' if number == 1 else 's'}"


class TimeLeft:
    """How fast a task goes and how long the rest of it takes: nothing until that is known.

    Before its first frame a task loads, so the pace is that of the frames after the first report; a few of them, over
    a few seconds, make it known.
    """

    def __init__(self, total: int, done: int, clock: Callable[[], float]) -> None:
        self._total = total
        self._done = done
        self._clock = clock
        self._first: tuple[int, float] | None = None  # how many were done at the first report, and when it came

    def advance(self, count: int) -> None:
        """Take a report of `count` more frames."""
        self._done += count
        if self._first is None:
            self._first = self._done, self._clock()

    def to_text(self) -> str:
        """Return the rate and the time left as text; "" where they are not known yet."""
        if self._first is None:
            return ""
        done, time_s = self._first
        made, took_s = self._done - done, self._clock() - time_s
        if made < KNOWN_FRAMES or took_s < KNOWN_S:
            return ""
        left = self._total - self._done
        return f"{made / took_s:.2f} frames/s" + (f", {duration_text(left * took_s / made)} left" if left > 0 else "")


class TerminalProgress:
    """A bar with rate and time left, once they are known, for a terminal."""

    def __init__(self, stream: TextIO, *, clock: Callable[[], float] = time.monotonic) -> None:
        from tqdm import tqdm

        self._make: Callable[..., tqdm] = tqdm
        self._stream = stream
        self._clock = clock
        self._bar: tqdm | None = None
        self._left = TimeLeft(0, 0, clock)

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Open the bar."""
        self.finish()
        self._left = TimeLeft(total, done, self._clock)
        # {postfix} in place of tqdm's own rate and time left, which begin with guesses from the time of loading.
        shown = "{l_bar}{bar}| {n_fmt}/{total_fmt} [{elapsed}{postfix}]"
        self._bar = self._make(
            total=total, initial=done, desc=label, file=self._stream, dynamic_ncols=True, bar_format=shown
        )

    def advance(self, count: int = 1) -> None:
        """Move the bar."""
        self._left.advance(count)
        if self._bar is not None:
            self._bar.set_postfix_str(self._left.to_text(), refresh=False)
            self._bar.update(count)

    def note(self, text: str, subject: str = "") -> None:
        """Print above the bar."""
        del subject
        if self._bar is not None:
            self._bar.clear()
        print(text, file=self._stream, flush=True)
        if self._bar is not None:
            self._bar.refresh()

    def finish(self) -> None:
        """Leave the bar where it stands."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


class PlainProgress:
    """A line every few seconds, for a log file."""

    def __init__(self, stream: TextIO, *, every_s: float = 5.0, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._every_s = every_s
        self._clock = clock
        self._label = ""
        self._total = self._done = 0
        self._left = TimeLeft(0, 0, clock)
        self._last_s = 0.0
        self._open = False

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Print the task's label and number of frames."""
        self.finish()
        self._label, self._total, self._done = label, total, done
        self._left = TimeLeft(total, done, self._clock)
        self._last_s = self._clock()
        self._open = True
        self.note(f"{label}: {counted(total, 'frame')}" + (f", {done} there already" if done else ""))

    def advance(self, count: int = 1) -> None:
        """Print how many are done, and once they are known the rate and the time left, once in `every_s` seconds."""
        self._done += count
        self._left.advance(count)
        if self._clock() - self._last_s >= self._every_s:
            self._say()

    def _say(self) -> None:
        self._last_s = self._clock()
        remaining = self._left.to_text()
        done = f"{self._done:,}/{counted(self._total, 'frame')}"
        self.note(f"{self._label}: {done}" + (f", {remaining}" if remaining else ""))

    def note(self, text: str, subject: str = "") -> None:
        """Print a line."""
        del subject
        print(text, file=self._stream, flush=True)

    def finish(self) -> None:
        """Print the final count."""
        if self._open:
            self._open = False
            self._say()


class JsonProgress:
    """Messages for another process, one a line: MARK, then JSON with one key.

    {"start": {"label": text, "total": frames, "done": frames}}, {"advance": frames}, {"note": sentence} (with
    "subject", if it has one), {"finish": true}; the command that runs the task adds {"error": sentence} or
    {"result": sentence}. "parts" holds the parts of a sentence that has some, by its key.
    """

    def __init__(self, stream: TextIO, *, lost: Callable[[], object]) -> None:
        """Write to a stream; `lost` is called when its reader is gone."""
        self._stream = stream
        self._lost = lost

    def tell(self, message: dict[str, Any]) -> None:
        """Send a message."""
        parts = {name: to_content(text) for name, text in message.items() if isinstance(text, Message)}
        try:
            print(MARK + json.dumps(message | ({"parts": parts} if parts else {})), file=self._stream, flush=True)
        except BrokenPipeError:
            self._lost()

    def start(self, label: str, total: int, done: int = 0) -> None:
        """Send the task's label and number of frames."""
        self.tell({"start": {"label": label, "total": total, "done": done}})

    def advance(self, count: int = 1) -> None:
        """Send that `count` more frames are done."""
        self.tell({"advance": count})

    def note(self, text: str, subject: str = "") -> None:
        """Send a sentence for the user."""
        self.tell({"note": text, "subject": subject} if subject else {"note": text})

    def finish(self) -> None:
        """Send that the task has ended."""
        self.tell({"finish": True})


def read_message(line: str) -> dict[str, Any] | None:
    """Return the message in a line of another process's output; None where there is none.

    Other output may precede it on the same line, since libraries buffer their output in blocks.
    """
    _, mark, text = line.partition(MARK)
    if not mark:
        return None
    try:
        message = json.loads(text)
    except ValueError:  # the message is cut off, or other output contains the mark
        return None
    if not isinstance(message, dict):
        return None
    return message | {name: from_content(parts) for name, parts in message.pop("parts", {}).items()}
