# SPDX-License-Identifier: GPL-3.0-or-later
"""The analyses stand on the extra evaluate."""

import pytest

pytest.importorskip("scipy", reason="needs the extra evaluate: pip install '.[evaluate]'")
pytest.importorskip("pandas", reason="needs the extra evaluate: pip install '.[evaluate]'")
