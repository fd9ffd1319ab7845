"""Rules of the project as a whole that import-linter cannot state."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parent.parent
HEAVY = {"numba", "pybullet", "torch"}


def _modules_after(statements: str) -> set[str]:
    """Names of all modules that a fresh interpreter holds after these statements."""
    program = f"import sys\n{statements}\nprint(*sys.modules, sep='\\n')"
    finished = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert finished.returncode == 0, finished.stderr
    return set(finished.stdout.split())


@pytest.mark.parametrize(
    "statements",
    [
        "import hide_tasks.contract",
        "import hide_tasks",
        "import hide_tasks\nfor name in hide_tasks.ALL_TASKS: hide_tasks.load(name)",
        "import server.cli",
        "import web",
    ],
)
def test_the_catalogue_and_the_server_start_light(statements: str) -> None:
    assert _modules_after(statements) & HEAVY == set()


def test_the_client_needs_no_database() -> None:
    wanted = {"httpx", "server.schemas"}
    unwanted = HEAVY | {"alembic", "sqlalchemy", "server.models", "server.db"}

    found = _modules_after("import server.client, server.client_uploads, server.client_screen")

    assert found & (wanted | unwanted) == wanted


def test_the_contract_imports_nothing_of_ours() -> None:
    graph = grimp.build_graph("hide_tasks", cache_dir=None)

    assert graph.find_modules_directly_imported_by("hide_tasks.contract") == set()


def _key(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_dependency_is_locked() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    asked = project["project"]["dependencies"] + project["build-system"]["requires"]
    for extra in project["project"]["optional-dependencies"].values():
        asked += extra
    lines = (ROOT / "constraints.txt").read_text().splitlines()[1:]
    pins = [re.fullmatch(r"([\w.-]+)==([\w.]+)", line) for line in lines]

    assert all(pins), "constraints.txt holds more than name==version; run `make lock`"
    locked = {_key(pin[1]) for pin in pins if pin}
    assert {_key(re.split(r"[^\w.-]", one)[0]) for one in asked} <= locked
