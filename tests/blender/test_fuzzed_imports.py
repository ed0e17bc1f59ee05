# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that are changed by structure are imported, or refused in a line; `tests/fuzz_inputs.py` tries thousands."""

from fuzz.cases import run_case


def test_changed_meshes_are_imported_or_refused(tmp_path):
    ended = {"accepted": 0, "refused": 0}
    for number in range(60):
        outcome = run_case("imported_meshes", 2026, number, tmp_path / "case")
        assert outcome.kind != "finding", f"case {number}: {outcome.told}"
        ended[outcome.kind] += 1
    assert min(ended.values()) > 5
