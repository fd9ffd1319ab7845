"""What machines are told that may join the cluster, and who is told nothing."""

import json
from pathlib import Path

import httpx
import pytest

from server import cluster
from server.access import Scope
from tests.server.clients import served
from tests.server.people import peopled, token_of, visitor
from workers.engines.membership import CLUSTER, Membership, NoMember, ask

pytest.importorskip("distributed", reason="Dask is not installed: pip install 'hide-seek[dask]'")

SCHEDULER = "tls://127.0.0.1:1"  # nobody is there


def test_a_token_for_workers_opens_the_cluster_and_nothing_else(tmp_path: Path) -> None:
    with peopled(tmp_path, scheduler=SCHEDULER) as app:
        machine = visitor(app, token_of(app, "admin", [Scope.WORK]))
        others = [scope for scope in Scope if scope is not Scope.WORK]

        told = Membership.model_validate(machine.get(CLUSTER).json())

        assert told.scheduler == SCHEDULER
        assert machine.get("/api/v1/evaluations").status_code == 403
        assert visitor(app, token_of(app, "admin", others)).get(CLUSTER).status_code == 403
        assert visitor(app, token_of(app, "maintainer")).get(CLUSTER).status_code == 403
        assert visitor(app).get(CLUSTER).status_code == 401
        assert told.key not in repr(told)


def test_the_certificate_stays_and_its_key_is_the_servers_alone(tmp_path: Path) -> None:
    made = cluster.membership(tmp_path, SCHEDULER)
    file = tmp_path / cluster.FILE

    assert cluster.membership(tmp_path, "tls://other:1") == made.model_copy(
        update={"scheduler": "tls://other:1"}
    )
    assert file.stat().st_mode & 0o777 == 0o600
    assert json.loads(file.read_text()).keys() == {"certificate", "key"}
    assert made.security().require_encryption is True


def test_what_keeps_a_machine_out_is_one_line(tmp_path: Path) -> None:
    with served(tmp_path) as (_, here):
        address = str(here.base_url)
        with pytest.raises(NoMember, match="404: This server has no cluster") as none:
            ask(address, None)
        with pytest.raises(NoMember, match="401: Authorization") as wrong:
            ask(address, "nonsense")

    with pytest.raises(NoMember, match="cannot be reached") as silent:
        ask("http://127.0.0.1:1", None)
    with pytest.raises(NoMember, match="cannot be reached") as nowhere:
        ask("127.0.0.1", None)

    assert [one.value.final for one in (none, wrong, silent, nowhere)] == [True, True, False, True]


def test_a_server_whose_scheduler_is_away_says_so(tmp_path: Path) -> None:
    with served(tmp_path, scheduler=SCHEDULER) as (hub, here):
        assert hub.engine is not None
        ready: httpx.Response = here.get("/api/v1/health/ready")

    assert ready.status_code == 503
    assert ready.json()["checks"]["cluster"] != "ok"
