# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes that wait for orders in JSON lines, so that several can be measured in turns."""

import json
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any


class ContestantError(Exception):
    """A process ended before it answered; the message holds its last words."""


class Contestant:
    """A process that waits for orders."""

    def __init__(self, name: str, command: Sequence[str | Path]) -> None:
        self.name = name
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the process
        self._process = subprocess.Popen(
            [str(part) for part in command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._orders, self._answers = self._process.stdin, self._process.stdout
        self.start: Any = self.answer()  # a dict; of the hard cases a list
        self.turns: list[float] = []

    def answer(self) -> dict[str, Any]:
        """Wait for the next answer. Raises ContestantError where none comes."""
        for line in self._answers:
            if line.startswith("@"):
                return json.loads(line[1:])
        self._process.wait()
        self._log.seek(0)
        words = self._log.read().decode(errors="replace").strip().splitlines()
        raise ContestantError(f"{self.name}: {words[-1] if words else 'ended without a word'}")

    def send(self, **order: Any) -> None:
        """Give an order without waiting."""
        self._orders.write(json.dumps(order) + "\n")
        self._orders.flush()

    def ask(self, **order: Any) -> dict[str, Any]:
        """Give an order and wait for the answer."""
        self.send(**order)
        return self.answer()

    def take_turn(self, frames: list[int]) -> dict[str, Any]:
        """Let it work; remember how long a frame took."""
        answer = self.ask(do="time", frames=frames)
        self.turns.append(answer["frame_s"])
        return answer

    def stop(self) -> None:
        """End the process."""
        self._orders.close()
        self._process.wait()
