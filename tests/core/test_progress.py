# SPDX-License-Identifier: GPL-3.0-or-later
"""Progress on a log and on a terminal."""

import io
import json

from noisy_world.core.progress import MARK, JsonProgress, PlainProgress, TerminalProgress, read_message


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


def test_a_terminal_without_a_task_takes_notes_and_a_new_task_ends_the_last():
    stream = io.StringIO()
    progress = TerminalProgress(stream)
    progress.advance()
    progress.note("early")
    progress.finish()
    assert stream.getvalue() == "early\n"
    progress.start("first", 2)
    progress.start("second", 3)
    progress.finish()
    assert stream.getvalue().index("first") < stream.getvalue().index("second")


def test_messages_for_a_program_come_back_as_they_were_told():
    stream = io.StringIO()
    progress = JsonProgress(stream, lost=lambda: None)
    progress.start("rendering", 8, done=3)
    progress.advance(2)
    progress.note('a note, quoted "so"')
    progress.finish()
    lines = stream.getvalue().splitlines()
    assert [json.loads(line.removeprefix(MARK)) for line in lines] == [
        {"start": {"label": "rendering", "total": 8, "done": 3}},
        {"advance": 2},
        {"note": 'a note, quoted "so"'},
        {"finish": True},
    ]
    assert [read_message(f"Blender's own {line}") for line in lines] == [read_message(line) for line in lines]
    for nothing in ("Fra:1 Mem:2", MARK, f"{MARK}[1]", lines[0][:-4]):
        assert read_message(nothing) is None


def test_a_reader_that_is_gone_is_told_once_a_message():
    class Gone(io.StringIO):
        def write(self, _):
            raise BrokenPipeError

    lost = []
    JsonProgress(Gone(), lost=lambda: lost.append(True)).advance()
    assert lost == [True]
