"""The table of faults names tests that there are, and every test of the suite that makes faults."""

import ast
import re
from pathlib import Path

from tests.chaos.systems import SYSTEMS
from tests.chaos.test_kills import MOMENTS, is_tried

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


def tried(victim: str, engine: str) -> str:
    """When a part is killed, as the table says it."""
    names = dict(zip(MOMENTS, ("start", "mid", "ack"), strict=True))
    found = [name for moment, name in names.items() if is_tried(engine, victim, moment)]
    return "✓" if len(found) == len(names) else ", ".join(found)


def test_every_part_that_is_killed_has_its_row() -> None:

    rows = {
        "policy": "policy",
        "simulator": "simulator",
        "supervisor": "supervisor (Pebble's worker)",
        "worker": "`hide worker`",
        "scheduler": "`hide scheduler`",
        "server": "server",
    }
    for victim, called in rows.items():
        engines = [
            tried(victim, name) if victim in kind.victims else "–" for name, kind in SYSTEMS.items()
        ]
        assert f"| {called} | start, mid, ack | {' | '.join(engines)} |" in TABLE
