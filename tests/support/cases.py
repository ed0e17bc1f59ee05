# SPDX-License-Identifier: GPL-3.0-or-later
"""Many cases in one test: every one is tried, and each that fails is reported under its values."""

import functools
import inspect
import itertools


def cases(names, values):
    """Like pytest.mark.parametrize, but one test that loops: fixtures are made once and shared by all cases.

    For inputs that distinguish little from each other; what deserves a line of its own in the report is parametrized.
    Several of these decorators give every combination.
    """
    names = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    values = [value if len(names) > 1 else (value,) for value in values]

    def decorate(test):
        body, axes = getattr(test, "cases_of", (test, []))
        axes = [(names, values), *axes]
        taken = {name for axis_names, _ in axes for name in axis_names}
        signature = inspect.signature(body)

        @functools.wraps(body)
        def run(*instance, subtests, **fixtures):
            for chosen in itertools.product(*(axis_values for _, axis_values in axes)):
                case = {}
                for (axis_names, _), value in zip(axes, chosen, strict=True):
                    case.update(zip(axis_names, value, strict=True))
                with subtests.test(**case):
                    body(*instance, **fixtures, **case)

        run.cases_of = (body, axes)
        fixtures = [parameter for name, parameter in signature.parameters.items() if name not in taken]
        run.__signature__ = signature.replace(
            parameters=[*fixtures, inspect.Parameter("subtests", inspect.Parameter.KEYWORD_ONLY)]
        )
        return run

    return decorate
