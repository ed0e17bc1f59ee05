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
    now[0] += 60.0  # the scene is loaded
    for _ in range(40):
        progress.advance()
        now[0] += 0.5
    progress.note("a note")
    progress.finish()
    lines = stream.getvalue().splitlines()
    assert lines[0] == "rendering: 100 frames, 20 there already"
    # One frame after 60 s is no pace: by it the rest would take 79 min.
    assert lines[1] == "rendering: 21/100 frames"
    assert lines[2] == "rendering: 31/100 frames, 2.00 frames/s, 34 s left"
    assert lines[-2] == "a note"
    assert lines[-1].startswith("rendering: 60/100 frames, 1.95 frames/s, ")
    assert "\r" not in stream.getvalue()


def test_a_bar_says_how_long_it_takes_once_that_is_known():
    now = [0.0]
    stream = io.StringIO()
    progress = TerminalProgress(stream, clock=lambda: now[0])
    progress.start("rendering", 1000)
    now[0] += 300.0
    for _ in range(4):
        progress.advance()
        assert "left" not in stream.getvalue()
        now[0] += 2.0
    progress.advance(96)
    progress.finish()
    assert stream.getvalue().endswith("100/1000 [00:00, 12.38 frames/s, 73 s left]\n")


def test_a_task_that_is_done_has_no_time_left_and_nothing_to_do_divides_by_nothing():
    now = [0.0]
    stream = io.StringIO()
    progress = PlainProgress(stream, clock=lambda: now[0])
    progress.start("rendering", 10)
    for _ in range(10):
        progress.advance()
        now[0] += 1.0
    progress.finish()
    progress.start("rendering", 0)
    progress.finish()
    assert stream.getvalue().splitlines()[-3:] == [
        "rendering: 10/10 frames, 0.90 frames/s",
        "rendering: 0 frames",
        "rendering: 0/0 frames",
    ]


def test_a_terminal_has_a_bar_and_takes_notes_where_there_is_none():
    stream = io.StringIO()
    progress = TerminalProgress(stream)
    progress.advance()
    progress.note("early")
    progress.finish()
    assert stream.getvalue() == "early\n"
    progress.start("first", 4, done=1)
    progress.advance(2)
    progress.note("a note")
    progress.start("second", 3)
    progress.finish()
    text = stream.getvalue()
    assert text.index("\r") < text.index("a note\n") < text.index("3/4") < text.index("second")


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
