"""The pages of webhooks: made, tried, switched, ended, and seen by their owner alone."""

import re
from collections.abc import Iterator
from html import unescape

import pytest
from fastapi import FastAPI

from server import users, webhooks
from server.models import now
from server.states import DeliveryState, WebhookEvent
from server.webhooks import Outcome
from tests.server.clients import API, TestClient
from tests.server.people import form_of, peopled, signed_in, token_of, visitor, with_password

PATH = "/account/webhooks"
URL = "https://lab.example.org/hide"


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FastAPI]:
    with peopled(tmp_path_factory.mktemp("webhooks"), rate="100000/minute") as found:
        with_password(found, "submitter")
        yield found


@pytest.fixture(scope="module")
def browser(app: FastAPI) -> TestClient:
    return signed_in(app, "submitter")


def sent(browser: TestClient, path: str, **fields: object):
    """The answer to a form of the webhooks' pages."""
    csrf = form_of(browser.get(PATH).text)
    return browser.post(f"{PATH}{path}", data={"csrf": csrf, **fields})


def made(browser: TestClient, **fields: object) -> str:
    """A new webhook's path."""
    answer = sent(browser, "", **{"url": URL, "events": ["evaluation.completed"], **fields})
    assert answer.status_code == 200, answer.text
    [id] = set(re.findall(r"/account/webhooks/(wh_\w+)/trial", answer.text))
    return f"/{id}"


def secrets_on(text: str) -> list[str]:
    return re.findall(r"whsec_[\w+/=]+", unescape(text))


def test_the_secret_is_shown_once_and_kept_nowhere(browser: TestClient) -> None:
    answer = sent(browser, "", url=URL, events=["episode.fault"], description="<b>chat</b>")

    [secret] = secrets_on(answer.text)
    [id] = set(re.findall(r"/account/webhooks/(wh_\w+)/trial", answer.text))
    assert answer.headers["cache-control"] == "no-store"
    assert "<b>chat" not in answer.text and "<b>chat</b>" in unescape(answer.text)
    assert secret not in browser.get(f"{PATH}/{id}").text
    assert secret not in browser.get(PATH).text
    [again] = secrets_on(sent(browser, f"/{id}/secret").text)
    assert again != secret


def test_what_is_wrong_with_a_form_is_said_and_nothing_is_lost(browser: TestClient) -> None:
    before = browser.get(f"{API}/webhooks").json()

    inside = sent(browser, "", url="https://10.0.0.7/hide", events=["episode.final"])
    nothing = sent(browser, "", url=URL)

    assert inside.status_code == nothing.status_code == 422
    assert 'role="alert">url: ' in inside.text
    assert 'value="https://10.0.0.7/hide"' in inside.text
    assert re.findall(r'value="([\w.]+)" checked', inside.text) == ["episode.final"]
    assert 'role="alert">events: ' in nothing.text
    assert browser.get(f"{API}/webhooks").json() == before


def test_deliveries_are_shown_with_their_tries_and_sent_again(
    app: FastAPI, browser: TestClient
) -> None:
    path = made(browser)
    with app.state.hub.database.writing() as session:
        row = webhooks.find(session, path[1:], users.find(session, "submitter").id)
        data = {"evaluation": "<script>"}
        one = webhooks.add(session, row, WebhookEvent.EVALUATION_COMPLETED, data, time=now())
        session.flush()
        webhooks.note(one, Outcome(status=503), now())
        webhooks.note(one, Outcome(error="no answer in 10 s"), now())
        webhooks.note(one, Outcome(status=410), now())
        id = one.id

    text = browser.get(f"{PATH}{path}").text
    assert all(said in text for said in ("503", "no answer in 10 s", "410", "3 tries", ">failed<"))
    assert "it was switched off" in text.lower() and ">off<" in text
    assert "<script>" not in text.partition("<main")[2]
    assert id in browser.get(f"{PATH}{path}?state=failed").text
    assert id not in browser.get(f"{PATH}{path}?state=delivered").text

    again = sent(browser, f"{path}/deliveries/{id}/repetition")
    on = sent(browser, f"{path}/activity", active="true")

    assert again.headers["location"] == on.headers["location"] == f"{PATH}{path}#deliveries"
    [now_waits] = browser.get(f"{API}/webhooks{path}/deliveries").json()["items"]
    assert (now_waits["state"], now_waits["tries"]) == (DeliveryState.PENDING, [])
    assert ">on<" in browser.get(f"{PATH}{path}").text


def test_a_trial_is_a_delivery_and_an_end_forgets_all(browser: TestClient) -> None:
    path = made(browser)

    sent(browser, f"{path}/trial")
    assert "webhook.trial" in browser.get(f"{PATH}{path}").text
    sent(browser, f"{path}/activity", active="false")
    assert ">off<" in browser.get(f"{PATH}{path}").text
    ended = sent(browser, f"{path}/removal")

    assert ended.headers["location"] == PATH
    assert browser.get(f"{PATH}{path}").status_code == 404
    assert path not in browser.get(PATH).text


def test_nobody_elses_are_there(app: FastAPI, browser: TestClient) -> None:
    path = made(browser)
    other = visitor(app, token_of(app, "admin"))

    answers = [other.get(f"{PATH}{path}")] + [
        other.post(f"{PATH}{path}/{what}", data={"active": "true"})
        for what in ("activity", "secret", "trial", "removal", "deliveries/msg/repetition")
    ]

    assert [one.status_code for one in answers] == [404] * 6
    assert path not in other.get(PATH).text
    assert browser.get(f"{PATH}{path}").status_code == 200


def test_a_form_of_another_page_changes_nothing(browser: TestClient) -> None:
    path = made(browser)

    assert browser.post(f"{PATH}{path}/removal").status_code == 403
    assert browser.get(f"{PATH}{path}").status_code == 200


def test_whoever_only_reads_has_none_and_is_offered_none(app: FastAPI) -> None:
    reader = visitor(app, token_of(app, "viewer"))

    assert reader.get(PATH).status_code == 403
    for page in ("/account", "/evaluations"):
        assert PATH not in reader.get(page).text
