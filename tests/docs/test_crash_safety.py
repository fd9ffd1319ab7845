"""The table of faults names tests that there are, and every test of the suite that makes faults."""

import ast
import re
from pathlib import Path

TESTS = Path(__file__).parents[1]
TABLE = (TESTS.parent / "docs" / "crash_safety.md").read_text()


def of_file(file: Path) -> set[str]:
    """Names of a file's tests, with the file, from the folder of all tests."""
    names = [node.name for node in ast.parse(file.read_text()).body if hasattr(node, "name")]
    return {f"{file.relative_to(TESTS)}::{name}" for name in names if name.startswith("test_")}


def named() -> set[str]:
    return set(re.findall(r"`([\w/]+\.py::\w+)`", TABLE))


def test_every_test_that_is_named_is_there() -> None:
    files = {name.partition("::")[0] for name in named()}

    assert len(named()) > 30
    assert named() <= set().union(*(of_file(TESTS / file) for file in files))


def test_every_test_of_faults_is_named() -> None:
    made = set().union(*map(of_file, (TESTS / "chaos").glob("test_*.py")))

    assert made and made <= named()


def test_every_part_that_is_killed_has_its_row() -> None:
    from tests.chaos.systems import SYSTEMS

    rows = {
        "policy": "policy",
        "simulator": "simulator",
        "supervisor": "supervisor (Pebble's worker)",
        "worker": "`hide worker`",
        "scheduler": "`hide scheduler`",
        "server": "server",
    }
    for victim, called in rows.items():
        engines = [("–", "✓")[victim in kind.victims] for kind in SYSTEMS.values()]
        assert f"| {called} | start, mid, ack | {' | '.join(engines)} |" in TABLE
