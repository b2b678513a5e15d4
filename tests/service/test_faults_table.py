"""The table of faults names, for each, the tests that break it."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "deploy" / "FAULTS.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| fault |")
]


def test_every_fault_says_what_it_costs_and_names_a_test_that_is_there() -> None:
    assert len(ROWS) > 20
    for fault, *said, tests in ROWS:
        assert len(said) == 3, fault
        assert all(said), fault
        paths = re.findall(r"`(tests/[^`]+)`", tests)
        assert paths, fault
        assert [path for path in paths if not (ROOT / path).exists()] == [], fault
