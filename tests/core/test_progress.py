# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress on a log and on a terminal."""

import io

from noisy_world.core.progress import PlainProgress, TerminalProgress


def test_plain_lines_come_now_and_then_with_rate_and_time_left():
    now = [0.0]
    stream = io.StringIO()
    progress = PlainProgress(stream, every_s=5, clock=lambda: now[0])
    progress.start("rendering", 100, done=20)
    for _ in range(40):
        now[0] += 0.5
        progress.advance()
    progress.note("a note")
    progress.finish()
    lines = stream.getvalue().splitlines()
    assert lines[0] == "rendering: 100 frames, 20 there already"
    assert lines[1] == "rendering: 30/100 frames, 2.00 frames/s, 35 s left"
    assert lines[-2:] == ["a note", "rendering: 60/100 frames, 2.00 frames/s, 20 s left"]
    assert len(lines) == 7
    assert "\r" not in stream.getvalue()


def test_nothing_to_do_divides_by_nothing():
    stream = io.StringIO()
    progress = PlainProgress(stream, clock=lambda: 1.0)
    progress.start("rendering", 0)
    progress.finish()
    assert "0/0 frames" in stream.getvalue()


def test_a_terminal_has_a_bar():
    stream = io.StringIO()
    progress = TerminalProgress(stream)
    progress.start("rendering", 4, done=1)
    progress.advance(2)
    progress.note("a note")
    progress.finish()
    text = stream.getvalue()
    assert "\r" in text
    assert "3/4" in text
    assert "a note\n" in text
