"""Health and versions over HTTP."""

import pytest

from tests.server.clients import (
    API,
    TestClient,
    Worker,
    create,
    hub_of,
)
from workers.sandbox.choice import best


def test_health(here: TestClient) -> None:
    create(here)
    Worker(hub_of(here), here)
    create(here)

    assert here.get(f"{API}/health/live").json() == {"status": "ok"}
    ready = here.get(f"{API}/health/ready")
    assert ready.status_code == 200
    assert ready.json() == {
        "status": "ok", "checks": {"ledger": "ok", "disk": "ok"}, "workers": 0, "running": 1,
        "queued": 1, "sandbox": best(),
    }  # fmt: skip
    assert here.get(f"{API}/version").json()["suite"] == "hide 1"


def test_a_full_disk_is_told(here: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    from server import hub

    monkeypatch.setattr(hub, "RESERVE", 2**62)

    answer = here.get(f"{API}/health/ready")

    assert answer.status_code == 503
    assert answer.json()["status"] == "degraded"
    assert answer.json()["checks"]["disk"].startswith("full")
