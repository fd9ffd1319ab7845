"""Webhooks: signed deliveries that come in spite of failures, kills and strangers' addresses."""

import json
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
from standardwebhooks import Webhook as Verifier

from hide_tasks.contract import Failure
from server import webhooks
from server.deliverer import send, signed
from server.hub import Hub
from server.models import Delivery, Webhook, now
from server.states import DeliveryState, WebhookEvent
from server.webhooks import BACK_OFF, Outcome
from tests.processes import wait_for
from tests.server import ledgers
from tests.server.clients import API, TestClient, client, create, hub_of, problem_of
from tests.server.people import peopled, token_of, visitor
from tests.server.receivers import Receiver, dripping, receiver

HERE = {"allow_webhook": ("127.0.0.1",)}
EVERY = [one.value for one in WebhookEvent]


@pytest.fixture
def here(tmp_path: Path) -> Iterator[TestClient]:
    with client(tmp_path, **HERE) as found:
        yield found


def hooked(here: httpx.Client, to: Receiver, **wanted: object) -> str:
    """The id of a webhook that tells a receiver."""
    answer = here.post(f"{API}/webhooks", json={"url": to.url} | wanted)
    assert answer.status_code == 201, answer.text
    to.secret = answer.json()["secret"]
    return str(answer.json()["id"])


def told(here: httpx.Client, hook: str) -> list[dict[str, Any]]:
    """Its deliveries, the oldest first."""
    return here.get(f"{API}/webhooks/{hook}/deliveries").json()["items"][::-1]


def tries(here: httpx.Client, hook: str) -> int:
    """How often its deliveries were tried, together."""
    return sum(len(one["tries"]) for one in told(here, hook))


def played(hub: Hub) -> None:
    with hub.database.writing() as session:
        while ledgers.play_shard(session, hub.blobs, lambda _: Failure.OVERCOUNT):
            pass


def hasten(hub: Hub) -> None:
    """The time of the next try has come."""
    with hub.database.writing() as session:
        for row in session.query(Delivery).filter_by(state="pending"):
            row.due = now()


def test_what_happens_is_told_signed_and_once(here: TestClient) -> None:
    with receiver() as to:
        hook = hooked(here, to, events=EVERY)
        evaluation = create(here)["id"]
        played(hub_of(here))
        wait_for(lambda: len(to.taken) == 5, "five deliveries")
        wait_for(lambda: all(one["state"] == "delivered" for one in told(here, hook)), "notes")

        assert to.kinds() == [
            "evaluation.queued",
            "evaluation.running",
            "episode.final",
            "episode.final",
            "evaluation.completed",
        ]
        assert {body["data"]["evaluation"] for _, body in to.taken} == {evaluation}
        assert to.taken[2][1]["data"]["failure"] == "overcount"
        assert [one["id"] for one in told(here, hook)] == to.tried
        assert [json.loads(str(one["body"])) for one in told(here, hook)] == [
            body for _, body in to.taken
        ]
        assert [one["tries"][0]["status"] for one in told(here, hook)] == [204] * 5


def test_by_default_it_is_told_of_ends(here: TestClient) -> None:
    with receiver() as to:
        hook = hooked(here, to)
        here.post(f"{API}/evaluations/{create(here)['id']}/cancellation")
        wait_for(lambda: to.taken, "a delivery")

        assert to.kinds() == ["evaluation.cancelled"]
        assert len(told(here, hook)) == 1


def test_what_a_receiver_refuses_comes_again_later_under_the_same_id(here: TestClient) -> None:
    with receiver(500, 302) as to:
        hook = hooked(here, to)
        here.post(f"{API}/evaluations/{create(here)['id']}/cancellation")
        for number in (1, 2):
            wait_for(lambda n=number: tries(here, hook) == n, f"try {number}")
            [waiting] = told(here, hook)
            assert waiting["state"] == "pending" and waiting["due"] > waiting["created"]
            hasten(hub_of(here))
        wait_for(lambda: to.taken, "the delivery")
        wait_for(lambda: told(here, hook)[0]["state"] == "delivered", "its note")

        [done] = told(here, hook)
        assert [one["status"] for one in done["tries"]] == [500, 302, 204]
        assert to.tried == [done["id"]] * 3


def test_a_killed_server_forgets_nothing(tmp_path: Path) -> None:
    """What a kill leaves is a ledger; here one whose deliveries were not made or not noted."""
    with receiver() as to:
        with client(tmp_path, **HERE) as before:
            hub = hub_of(before)
            hook = hooked(before, to, events=EVERY)
            hub.deliverer.stop()
            create(before)
            played(hub)
            assert told(before, hook) == []
            with hub.database.writing() as session:
                webhooks.collect(session)
            [first, *_] = told(before, hook)
            with hub.database.reading() as session:
                row = webhooks.delivery(session, first["id"])
                assert row and send(row, ("127.0.0.1",)).good

        with client(tmp_path, **HERE) as after:
            wait_for(lambda: len(to.taken) == 6, "all deliveries")

            ids = [one["id"] for one in told(after, hook)]
            assert to.tried == [ids[0], *ids]  # the one that was sent and not noted comes twice
            assert len(set(ids)) == 5


def test_one_whose_receiver_hangs_does_not_hold_up_others(here: TestClient) -> None:
    with receiver() as slow, receiver() as quick:
        slow.hold.clear()
        hooked(here, slow)
        hooked(here, quick)

        here.post(f"{API}/evaluations/{create(here)['id']}/cancellation")

        wait_for(lambda: quick.taken, "the quick one's delivery")
        assert slow.tried == []


@pytest.mark.parametrize("line", [b"H", b"HTTP/1.1 200 OK\r\nX: "])
def test_a_receiver_that_drips_is_left(line: bytes) -> None:
    with dripping(lambda number: line[number : number + 1] or b"x") as url:
        hook = Webhook(id="wh_1", url=url, secret=webhooks.new_secret())
        row = Delivery(id="msg_1", webhook=hook, body="{}")

        outcome = send(row, ("127.0.0.1",), within=0.6)

    assert outcome.status is None and "no answer within 0.6 s" in str(outcome.error)


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("https://127.0.0.1/x", "not a public address"),
        ("https://169.254.169.254/latest", "not a public address"),
        ("https://[::1]:8000/", "not a public address"),
        ("http://example.org/", "is not encrypted"),
        ("ftp://example.org/", "is no URL"),
        ("https://me:pw@example.org/", "neither user"),
        ("nonsense", "is no URL"),
    ],
)
def test_where_a_stranger_may_not_send_us(tmp_path: Path, url: str, why: str) -> None:
    with client(tmp_path) as here:
        answer = here.post(f"{API}/webhooks", json={"url": url})

    assert answer.status_code == 422
    assert [one["field"] for one in problem_of(answer)["errors"]] == ["url"]
    assert why in problem_of(answer)["detail"]


def test_a_name_that_leads_inside_is_found_out_when_it_is_looked_up() -> None:
    with receiver() as to:
        port = to.server.server_port
        hook = Webhook(id="wh_1", url=f"https://localhost:{port}/", secret=webhooks.new_secret())

        outcome = send(Delivery(id="msg_1", webhook=hook, body="{}"))

    assert "localhost is not a public address" in str(outcome.error)


def test_tries_come_later_each_time_and_end_with_the_webhook_switched_off() -> None:
    waits, moment = [], now()
    row = Delivery(webhook=Webhook(id="wh_1", active=True), tries=[], state="pending")
    while row.state == DeliveryState.PENDING:
        webhooks.note(row, Outcome(status=503), moment)
        if row.due:
            waits.append((row.due - moment) / timedelta(seconds=1))

    assert row.state == DeliveryState.FAILED and len(row.tries) == len(BACK_OFF) + 1
    assert all(least <= wait <= 1.1 * least for least, wait in zip(BACK_OFF, waits, strict=True))
    assert not row.webhook.active and "took nothing in 10 tries" in str(row.webhook.reason)


def test_a_receiver_that_is_gone_is_told_no_more(here: TestClient) -> None:
    with receiver(410) as to:
        hook = hooked(here, to, events=["evaluation.queued"])
        create(here)
        wait_for(lambda: not here.get(f"{API}/webhooks/{hook}").json()["active"], "its end")
        create(here)

        stands = here.get(f"{API}/webhooks/{hook}").json()
        assert "is gone (410)" in stands["reason"]
        assert [one["state"] for one in told(here, hook)] == ["failed"]

        here.post(f"{API}/webhooks/{hook}/changes", json={"active": True})
        last = create(here)["id"]
        wait_for(lambda: to.taken, "what happened since")
        assert [body["data"]["evaluation"] for _, body in to.taken] == [last]


def test_a_trial_and_a_delivery_that_is_asked_for_again(here: TestClient) -> None:
    with receiver() as to:
        hook = hooked(here, to)
        tried = here.post(f"{API}/webhooks/{hook}/trial")
        wait_for(lambda: tries(here, hook), "the note of the trial")
        path = f"{API}/webhooks/{hook}/deliveries/{tried.json()['id']}/repetition"
        again = here.post(path)
        wait_for(lambda: len(to.taken) == 2, "the same again")

        assert (tried.status_code, again.status_code) == (202, 202)
        assert to.kinds() == ["webhook.trial"] * 2 and len(set(to.tried)) == 1


def test_a_new_secret_signs_what_follows(here: TestClient) -> None:
    with receiver() as to:
        hook = hooked(here, to)
        before = to.secret
        to.secret = here.post(f"{API}/webhooks/{hook}/secret").json()["secret"]
        here.post(f"{API}/webhooks/{hook}/trial")
        wait_for(lambda: to.taken, "the trial")

        assert to.secret != before and len(to.secret) > len("whsec_") + 40


def test_what_is_changed_and_removed(here: TestClient) -> None:
    with receiver() as to:
        hook = hooked(here, to, description="nightly")
        path = f"{API}/webhooks/{hook}"
        changed = here.post(f"{path}/changes", json={"events": ["episode.final"]}).json()
        here.post(f"{path}/trial")
        wait_for(lambda: to.taken, "the trial")
        removed = here.delete(path)

        assert (changed["events"], changed["description"]) == (["episode.final"], "nightly")
        assert "secret" not in changed
        assert removed.status_code == 204
        assert here.get(path).status_code == 404 and here.get(f"{API}/webhooks").json() == []


def test_they_are_their_owners_and_tell_of_their_owners_evaluations(tmp_path: Path) -> None:
    with peopled(tmp_path, **HERE) as app, receiver() as own, receiver() as all_of_them:
        ann = visitor(app, token_of(app, "submitter"))
        bob = visitor(app, token_of(app, "maintainer"))
        hook = hooked(ann, own)
        hooked(ann, all_of_them, everybodys=True)

        for asking in (bob, ann):
            asking.post(f"{API}/evaluations/{create(asking)['id']}/cancellation")
        wait_for(lambda: len(all_of_them.taken) == 2, "both")
        wait_for(lambda: own.taken, "one's own")

        assert len(own.taken) == 1
        assert bob.get(f"{API}/webhooks/{hook}").status_code == 404
        assert bob.get(f"{API}/webhooks").json() == []
        for _ in range(webhooks.MOST - 2):
            hooked(ann, own)
        assert ann.post(f"{API}/webhooks", json={"url": own.url}).status_code == 429


def test_the_signature_is_the_specifications() -> None:
    """The verifier is the specification's own; what was changed on the way is found out."""
    secret = webhooks.new_secret()
    hook = Webhook(id="wh_1", url="https://example.org/", secret=secret)
    row = Delivery(id="msg_1", webhook=hook, body='{"type":"webhook.trial"}')
    headers = signed(row, now())

    assert Verifier(secret).verify(row.body, headers) == {"type": "webhook.trial"}
    with pytest.raises(Exception, match="No matching signature"):
        Verifier(secret).verify(row.body + " ", headers)
