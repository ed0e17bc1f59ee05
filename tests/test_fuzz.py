# SPDX-License-Identifier: GPL-3.0-or-later
"""A few hundred mutated inputs; `tests/fuzz_inputs.py` tries as many as you like."""

import pytest
from fuzz.cases import AREAS, run_case

CASES = {"presets": 60, "trajectories": 120, "recordings": 60, "videos": 20, "meshes": 150, "datasets": 30}
CASES |= {"shaped_presets": 30, "mesh_headers": 60, "recording_files": 50, "estimates": 80, "definitions": 40}
CASES |= {"dataset_records": 25, "recipes": 25, "results": 12, "jpegs": 120, "bags": 120}


@pytest.mark.parametrize("area", AREAS)
def test_mutated_inputs_are_read_as_they_mean_or_refused(area, tmp_path):
    ended = {"accepted": 0, "refused": 0, "finding": 0}
    for number in range(CASES.get(area, 40)):
        outcome = run_case(area, 2026, number, tmp_path / "case")
        assert outcome.kind != "finding", f"{area}, seed 2026, case {number}: {outcome.told}"
        ended[outcome.kind] += 1
    assert min(ended["accepted"], ended["refused"]) > 0
