"""Servers that several tests ask."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.server import ledgers
from tests.server.clients import TestClient, client, hub_of
from tests.server.postgres import needs_postgres
from tests.web.conftest import site  # noqa: F401  # the filled site, once for all here too


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgresql", marks=needs_postgres)])
def on_each_database(request: pytest.FixtureRequest) -> Iterator[str]:
    """What is asked of the ledger holds in SQLite and in PostgreSQL: `ledgers.opened` obeys."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ledgers, "kind", request.param)
        yield request.param


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """A server with one completed evaluation, for requests that change nothing."""
    with client(tmp_path_factory.mktemp("api")) as found:
        hub = hub_of(found)
        ledgers.evaluated(hub.database, hub.blobs, tasks=["search_drawer"], episodes=2)
        yield found


@pytest.fixture
def here(tmp_path: Path) -> Iterator[TestClient]:
    """A server of the test's own."""
    with client(tmp_path) as found:
        yield found
