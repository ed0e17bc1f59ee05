# SPDX-License-Identifier: GPL-3.0-or-later
"""A generator's process, followed: a stand-in that says what the test wants."""

import sys
import time

import pytest

from noisy_world.core.progress import MARK, JsonProgress, read_message
from noisy_world.panel.background import BackgroundRun

TALK = f"import json, sys, time\ndef tell(**message): print({MARK!r} + json.dumps(message), flush=True)\n"
START = "tell(start={'label': 'rendering', 'total': 10, 'done': 2})\n"


def child(text, **options):
    return BackgroundRun([sys.executable, "-c", TALK + text], **options)


def until(run, condition, timeout_s=300):
    end_s = time.monotonic() + timeout_s
    while not condition(run):
        assert time.monotonic() < end_s, vars(run)
        run.poll()
        time.sleep(0.01)


def test_what_is_told_is_taken_in():
    run = child(
        START
        + "for _ in range(8): tell(advance=1)\ntell(note='a note', subject='hall')\ntell(finish=True)\ntell(result='8')"
    )
    assert (run.phase, run.active, run.fraction, run.frames_per_s) == ("starting", True, 0.0, None)
    run.wait()
    assert (run.phase, run.active, run.done, run.total, run.label) == ("finished", False, 10, 10, "rendering")
    assert (run.result, list(run.notes), run.error) == ("8", ["a note"], "")
    assert run.poll() is False


def test_the_rate_counts_this_run_alone(tmp_path):
    now = [0.0]
    wait = f"import os\nwhile not os.path.exists({str(tmp_path / 'go')!r}): time.sleep(0.01)\n"
    run = child(START + wait + "tell(advance=3)\ntime.sleep(60)", clock=lambda: now[0])
    until(run, lambda r: r.phase == "running")
    now[0] = 6.0
    (tmp_path / "go").touch()
    until(run, lambda r: r.done == 5)
    assert run.frames_per_s == 0.5
    run.close()


def test_an_error_is_the_same_sentence():
    run = child("tell(error='preset.yaml: scenes: is empty; name a scene')\nsys.exit(1)")
    run.wait()
    assert (run.phase, run.error) == ("failed", "preset.yaml: scenes: is empty; name a scene")


def test_a_bug_is_told_by_its_last_line():
    run = child(START + "raise RuntimeError('nobody expected this')")
    run.wait()
    assert run.phase == "failed"
    assert run.error == "the generator ended with status 1: RuntimeError: nobody expected this"


def test_much_output_does_not_hold_the_process_up():
    run = child(
        "print('x' * 300_000)\nprint('y' * 300_000, file=sys.stderr)\nprint('no end of line', end='')\n" + START
    )
    run.wait()
    assert (run.phase, run.total) == ("finished", 10)


@pytest.mark.parametrize("status", [0, 130])
def test_cancelled_it_ends_after_the_frame_in_hand(status):
    stop = "import signal\nstop = []\nsignal.signal(signal.SIGTERM, lambda *_: stop.append(1))\n"
    work = f"while not stop: time.sleep(0.01)\ntell(advance=1)\nsys.exit({status})"
    run = child(stop + START + work)
    until(run, lambda r: r.phase == "running")
    run.cancel()
    assert (run.phase, run.active) == ("stopping", True)
    run.wait()
    assert (run.phase, run.done, run.error) == ("finished" if status == 0 else "stopped", 3, "")


def test_cancelled_while_it_starts_up():
    run = child("time.sleep(60)")
    run.cancel()
    run.wait()
    assert (run.phase, run.error) == ("stopped", "")


def test_cancelled_twice_and_closed_it_ends_at_once():
    deaf = "import signal\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\n" + START + "time.sleep(60)"
    run = child(deaf)
    until(run, lambda r: r.phase == "running")
    run.cancel()
    run.cancel()
    run.wait()
    assert run.phase == "stopped"
    other = child(deaf)
    until(other, lambda r: r.phase == "running")
    other.close(timeout_s=0.2)  # its program would run on for a minute
    assert other.phase == "stopped"


def test_a_program_that_is_not_there():
    with pytest.raises(OSError, match="no-such-program"):
        BackgroundRun(["/no-such-program"])


def test_messages_are_found_behind_what_others_wrote():
    assert read_message(f"half a line{MARK}" + '{"advance": 1}\n') == {"advance": 1}
    for line in ("Blender 5.2\n", f"{MARK}\n", f"{MARK}[1]\n", f"{MARK}" + '{"advance": \n'):
        assert read_message(line) is None


def test_nobody_listens():
    class Gone:
        def write(self, _):
            raise BrokenPipeError

        def flush(self):
            pass

    lost = []
    JsonProgress(Gone(), lost=lambda: lost.append(1)).advance()
    assert lost == [1]
