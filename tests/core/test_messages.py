# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages in parts: what the command line says of them, and their way through another process."""

import io
import pickle

from noisy_world.core.errors import InputError, NoisyWorldError, StorageError
from noisy_world.core.errors import Action, CommandLineOnly, Message, PresetKey, either, offers, parts_of
from noisy_world.core.progress import JsonProgress, read_message

KEY = PresetKey("output.image", "jpg")
ALL = Message("none of it: ", PresetKey("camera.far_m"), either("mend it", Message("set ", KEY), Action.OVERWRITE))


def test_the_command_line_says_files_keys_and_options():
    assert str(InputError("a.yaml", "is 7", where="seed")) == "a.yaml: seed: is 7"
    assert str(InputError("a.yaml", "is 7", remedy="say less")) == "a.yaml: is 7; say less"
    assert str(StorageError("is a file", file="/d", remedy=Action.OTHER_FOLDER)) == (
        "/d: is a file; choose another folder with --out"
    )
    assert ALL == ("none of it: camera.far_m; mend it, set output.image: jpg, or replace the dataset with --overwrite")
    assert Message("bad", either("a", CommandLineOnly("b"))) == "bad; a, or b"
    assert str(NoisyWorldError("two\nlines", file="a\tb")) == "a\\tb: two\\nlines"


def test_an_error_keeps_the_parts_of_its_problem():
    error = InputError("a.yaml", ALL, where="output")
    assert error.message == str(error) == f"a.yaml: output: {ALL}"
    assert offers(error.message, Action.OVERWRITE)
    assert not offers(error.message, Action.RUN_AGAIN)
    assert not offers(str(error), Action.OVERWRITE), "a text has no parts"
    assert parts_of(NoisyWorldError(error.message).message) == parts_of(error.message)


def test_parts_go_through_another_process():
    stream = io.StringIO()
    listener = JsonProgress(stream, lost=lambda: None)
    error = InputError("a.yaml", ALL, where="seed", remedy=CommandLineOnly("see --list keys"))
    listener.tell({"error": error.message})
    listener.note(ALL, "room")
    listener.note("plain")
    told, noted, plain = map(read_message, stream.getvalue().splitlines())
    assert told == {"error": str(error)}
    assert (noted, plain) == ({"note": ALL, "subject": "room"}, {"note": "plain"})
    copied = pickle.loads(pickle.dumps(ALL))
    for sent, heard in ((error.message, told["error"]), (ALL, noted["note"]), (ALL, copied)):
        assert parts_of(heard) == parts_of(sent)
        assert len(parts_of(heard)) > 1
