"""The number of cases of the fuzz tests, and their counts.

LASSOKIN_FUZZ_CASES is the number over all fuzz tests: hundreds by default, the same ones in every run. `make
fuzz` runs more, and new ones in every run. A failing case is printed with its inputs.
"""

import os
from collections import Counter

from hypothesis import HealthCheck, Phase, settings

DEFAULT_CASES = 800
CASES = int(os.environ.get("LASSOKIN_FUZZ_CASES", DEFAULT_CASES))
COUNTED: Counter[str] = Counter()
"""Counts of cases by test and outcome; conftest.py prints them at the end."""


def fuzz(share):
    """Settings of a test that runs this share of all cases."""
    return settings(
        max_examples=max(8, round(CASES * share)),
        deadline=None,
        database=None,
        derandomize=CASES <= DEFAULT_CASES,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.explicit, Phase.generate, Phase.shrink],
        print_blob=False,
    )


def count(test, outcome):
    """Count one case."""
    COUNTED[f"{test}: {outcome}"] += 1


def report():
    """Lines: the number of all cases, and counts by test and outcome."""
    if not COUNTED:
        return []
    lines = [f"fuzzing: {sum(COUNTED.values())} cases (LASSOKIN_FUZZ_CASES={CASES})"]
    if CASES > DEFAULT_CASES:
        width = max(map(len, COUNTED))
        lines += [f"  {outcome:<{width}} {n:>7}" for outcome, n in sorted(COUNTED.items())]
    return lines
