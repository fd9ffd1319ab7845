"""Users mode: signing in, tokens, who may change what, quotas, rates, the audit log."""

from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from fastapi import FastAPI
from sqlalchemy import text
from sqlalchemy.exc import IntegrityError

from hide_tasks import SUITES
from server import credentials, lifecycle, users
from server.access import Role, Scope
from server.models import Evaluation, Token, User, now
from server.settings import Settings
from tests.server import ledgers
from tests.server.clients import API, SMALL, problem_of
from tests.server.people import (
    PASSWORD,
    application,
    bearer,
    form_of,
    peopled,
    signed_in,
    token_of,
    visitor,
    with_password,
)

BUILTIN = {"name": "mine", "spec": {"kind": "builtin", "name": "noop"}}


@pytest.fixture
def app(tmp_path: Path) -> Iterator[FastAPI]:
    with peopled(tmp_path, rate_sign_in="100/minute") as found:
        yield found


# --- browsers ---


def test_a_browser_signs_in_and_out(app: FastAPI) -> None:
    with_password(app, "submitter")

    browser = signed_in(app, "submitter")
    page = browser.get("/account")
    made = browser.post(
        f"{API}/evaluations", json=SMALL, headers={"X-CSRF-Token": form_of(page.text)}
    )
    out = browser.post("/logout", data={"csrf": form_of(page.text)})

    assert page.status_code == 200 and ">submitter</h1>" in page.text
    assert (made.status_code, made.json()["owner"]) == (202, "submitter")
    assert out.headers["location"] == "/login"
    assert browser.get("/account").headers["location"] == "/login?next=%2Faccount"


def test_a_stolen_cookie_is_worth_nothing_after_signing_out(app: FastAPI) -> None:
    with_password(app, "viewer")
    browser = signed_in(app, "viewer")
    cookie = {"Cookie": f"hide={browser.cookies['hide']}"}
    thief = visitor(app)
    assert thief.get("/account", headers=cookie).status_code == 200

    browser.post("/logout", data={"csrf": form_of(browser.get("/account").text)})

    assert thief.get("/account", headers=cookie).status_code == 303


def test_the_cookie_is_out_of_reach_of_scripts_and_plain_pages(tmp_path: Path) -> None:
    address = "https://evaluation.example.org"
    with peopled(tmp_path, public_url=address) as app:
        with_password(app, "viewer")
        browser = visitor(app, base_url=address)
        csrf = form_of(browser.get("/login").text)
        sent = {"csrf": csrf, "name": "viewer", "password": PASSWORD}
        cookies = browser.post("/login", data=sent).headers.get_list("set-cookie")

    [cookie] = [one for one in cookies if one.startswith("__Host-hide=")]
    parts = {part.strip().lower() for part in cookie.split(";")[1:]}
    assert {"httponly", "secure", "samesite=lax", "path=/"} <= parts
    assert not any(part.startswith("domain") for part in parts)


@pytest.mark.parametrize("name", ["viewer", "nobody", "submitter", "owner"])
def test_a_wrong_password_says_the_same_of_every_name(app: FastAPI, name: str) -> None:
    with_password(app, "viewer")  # the submitter has none
    browser = visitor(app)
    csrf = form_of(browser.get("/login").text)

    answer = browser.post("/login", data={"csrf": csrf, "name": name, "password": "wrong" * 3})

    assert answer.status_code == 401
    assert "This name and password do not go together." in answer.text
    assert "hide" not in browser.cookies


def test_a_form_of_another_browser_signs_nobody_in(app: FastAPI) -> None:
    with_password(app, "viewer")
    attacker, victim = visitor(app), visitor(app)
    csrf = form_of(attacker.get("/login").text)

    sent = {"csrf": csrf, "name": "viewer", "password": PASSWORD}
    answer = victim.post("/login", data=sent)

    assert answer.status_code == 403 and "hide" not in victim.cookies


@pytest.mark.parametrize(
    ("next", "led"),
    [
        ("/evaluations?state=running", "/evaluations?state=running"),
        ("//evil.example", "/"),
        ("/\\evil.example", "/"),
        ("https://evil.example", "/"),
        ("/\t/evil.example", "/"),
        ("evil", "/"),
    ],
)
def test_signing_in_leads_to_own_pages_alone(app: FastAPI, next: str, led: str) -> None:
    with_password(app, "viewer")
    browser = visitor(app)
    csrf = form_of(browser.get("/login").text)

    sent = {"csrf": csrf, "name": "viewer", "password": PASSWORD, "next": next}
    answer = browser.post("/login", data=sent)

    assert (answer.status_code, answer.headers["location"]) == (303, led)


@pytest.mark.parametrize("headers", [{}, {"X-CSRF-Token": ""}, {"X-CSRF-Token": "0" * 64}])
def test_a_cookie_alone_changes_nothing(app: FastAPI, headers: dict[str, str]) -> None:
    with_password(app, "admin")
    browser = signed_in(app, "admin")

    answers = [
        browser.post(f"{API}/evaluations", json=SMALL, headers=headers),
        browser.post(f"{API}/users", json={"name": "x", "role": "admin"}, headers=headers),
        browser.post("/account/tokens", data={"name": "x", "scopes": "read"}, headers=headers),
        browser.post("/logout", headers=headers),
    ]

    assert [answer.status_code for answer in answers] == [403] * 4
    assert browser.get(f"{API}/me").json()["via"] == "session"
    assert browser.get(f"{API}/evaluations").json()["items"] == []


def test_a_new_password_ends_every_other_sign_in(app: FastAPI) -> None:
    with_password(app, "viewer")
    here, there = signed_in(app, "viewer"), signed_in(app, "viewer")
    csrf = form_of(here.get("/account").text)

    wrong = here.post("/account/password", data={"csrf": csrf, "old": "x" * 12, "new": "n" * 12})
    short = here.post("/account/password", data={"csrf": csrf, "old": PASSWORD, "new": "n" * 9})
    right = here.post("/account/password", data={"csrf": csrf, "old": PASSWORD, "new": "n" * 12})

    assert (wrong.status_code, short.status_code, right.status_code) == (401, 422, 303)
    assert here.get("/account").status_code == 200
    assert there.get("/account").status_code == 303


def test_a_sign_in_ends_by_itself(app: FastAPI) -> None:
    with_password(app, "viewer")
    browser = signed_in(app, "viewer")

    with app.state.hub.database.writing() as session:
        session.execute(text("UPDATE sign_ins SET expires = '2020-01-01 00:00:00.000000'"))

    assert browser.get("/account").status_code == 303


# --- tokens ---


def test_a_token_is_told_once_and_kept_as_a_hash(app: FastAPI) -> None:
    asking = visitor(app, token_of(app, "submitter"))

    made = asking.post(f"{API}/tokens", json={"name": "ci", "scopes": ["read"]})
    listed = asking.get(f"{API}/tokens").json()["items"]

    token = made.json()["token"]
    assert made.status_code == 201 and credentials.parts(token)[0] == made.json()["id"]
    assert listed[0]["name"] == "ci" and "token" not in listed[0]
    secret = credentials.parts(token)[1].encode()
    for file in app.state.hub.folder.path.glob("ledger*"):
        assert secret not in file.read_bytes()
    assert visitor(app, token).get(f"{API}/me").json()["scopes"] == ["read"]


@pytest.mark.parametrize("spoil", [
    lambda token: token[:-1] + ("A" if token[-1] != "A" else "B"),
    lambda token: token.replace("hide_0", "hide_1", 1),
    lambda token: token + "x",
    lambda token: token[:0],
])  # fmt: skip
def test_a_token_that_is_not_quite_right_is_none(app: FastAPI, spoil) -> None:
    token = token_of(app, "viewer")

    answer = visitor(app).get(f"{API}/tasks", headers=bearer(spoil(token)))

    assert answer.status_code == 401 and problem_of(answer)["code"] == "not_signed_in"


def test_a_token_ends_when_revoked_when_expired_and_with_its_user(app: FastAPI) -> None:
    hub = app.state.hub
    revoked, expired, gone = (token_of(app, "viewer") for _ in range(3))
    used = visitor(app, revoked)
    id = credentials.parts(revoked)[0]
    assert used.post(f"{API}/tokens/{id}/revocation").json()["revoked"]
    with hub.database.writing() as session:
        row = session.get_one(Token, credentials.parts(expired)[0])
        row.expires = now() - timedelta(seconds=1)
    assert "revoked" in used.get(f"{API}/me").json()["detail"]
    assert "expired" in visitor(app, expired).get(f"{API}/me").json()["detail"]
    assert visitor(app, gone).get(f"{API}/me").status_code == 200

    admin = visitor(app, token_of(app, "admin"))
    left = admin.post(f"{API}/users/viewer/changes", json={"active": False})

    assert left.json()["active"] is False
    assert visitor(app, gone).get(f"{API}/me").status_code == 401


def test_a_token_makes_none_that_may_do_more(app: FastAPI) -> None:
    reading = visitor(app, token_of(app, "admin", [Scope.READ]))
    viewing = visitor(app, token_of(app, "viewer"))

    for asking in (reading, viewing):
        answer = asking.post(f"{API}/tokens", json={"name": "x", "scopes": ["read", "admin"]})
        assert answer.status_code == 422
        assert problem_of(answer)["errors"][0]["field"] == "scopes"


def test_a_token_may_do_less_when_its_user_may(app: FastAPI) -> None:
    token = token_of(app, "maintainer")
    admin = visitor(app, token_of(app, "admin"))

    admin.post(f"{API}/users/maintainer/changes", json={"role": "viewer"})

    assert visitor(app, token).get(f"{API}/me").json()["scopes"] == ["read"]


def test_tokens_of_others_are_not_there(app: FastAPI) -> None:
    id = credentials.parts(token_of(app, "viewer"))[0]
    other, admin = visitor(app, token_of(app, "submitter")), visitor(app, token_of(app, "admin"))

    assert other.get(f"{API}/tokens/{id}").status_code == 404
    assert other.post(f"{API}/tokens/{id}/revocation").status_code == 404
    assert admin.post(f"{API}/tokens/{id}/revocation").status_code == 200


def test_an_attempts_token_opens_nothing_else_and_no_user_reports(app: FastAPI) -> None:
    hub = app.state.hub
    with hub.database.writing() as session:
        ledgers.created(session, tasks=["search_drawer"], episodes=1)
        shard = lifecycle.next_shard(session)
        attempt, token = lifecycle.lease(session, shard, engine="local")
        [episode] = shard.episodes
        start = f"/internal/v1/attempts/{attempt.id}/episodes/{episode.id}/start"

    assert visitor(app, token).get(f"{API}/tasks").status_code == 401
    assert visitor(app, token_of(app, "admin")).post(start).status_code == 401
    assert visitor(app, token).post(start).status_code == 204


# --- whose it is ---


def test_only_the_owner_and_maintainers_change_what_is_theirs(app: FastAPI) -> None:
    hub = app.state.hub
    with hub.database.writing() as session:
        users.add(session, "other", Role.SUBMITTER, None)
    mine, other = (visitor(app, token_of(app, name)) for name in ("submitter", "other"))
    maintainer = visitor(app, token_of(app, "maintainer"))
    id = mine.post(f"{API}/evaluations", json=SMALL).json()["id"]
    assert mine.post(f"{API}/policies", json=BUILTIN).json()["owner"] == "submitter"

    refused = [
        other.post(f"{API}/evaluations/{id}/cancellation"),
        other.post(f"{API}/evaluations/{id}/resumption"),
        other.post(f"{API}/policies", json=BUILTIN),
        other.post(f"{API}/policies/checkpoints?name=mine", content=b"weights"),
    ]

    assert [(one.status_code, problem_of(one)["code"]) for one in refused] == [
        (403, "not_yours")
    ] * 4
    assert other.post(f"{API}/evaluations", json=SMALL | {"policy": "mine"}).status_code == 202
    assert maintainer.post(f"{API}/evaluations/{id}/cancellation").status_code == 202
    assert mine.post(f"{API}/policies", json=BUILTIN).json()["version"] == 2


def test_an_idempotency_key_is_its_users_own(app: FastAPI) -> None:
    headers = {"Idempotency-Key": "nightly"}
    first, second = (
        visitor(app, token_of(app, name)).post(f"{API}/evaluations", json=SMALL, headers=headers)
        for name in ("submitter", "maintainer")
    )

    assert first.json()["id"] != second.json()["id"]


def test_going_first_and_python_are_for_those_who_are_trusted(tmp_path: Path) -> None:
    python = {
        "name": "x",
        "spec": {"kind": "python", "target": "tests.workers.some_policies:Stays"},
    }
    with peopled(tmp_path, allow_python=True) as app:
        submitter, maintainer = (
            visitor(app, token_of(app, name)) for name in ("submitter", "maintainer")
        )

        first = SMALL | {"priority": 1}
        assert submitter.post(f"{API}/evaluations", json=first).status_code == 422
        assert maintainer.post(f"{API}/evaluations", json=first).status_code == 202
        answer = maintainer.post(f"{API}/policies", json=python)
        assert (answer.status_code, problem_of(answer)["code"]) == (403, "python_not_allowed")


# --- how much, how often ---


def test_attempts_are_counted_and_what_never_began_is_given_back(tmp_path: Path) -> None:
    with peopled(tmp_path, quota_attempts=2) as app:
        asking = visitor(app, token_of(app, "submitter"))
        ids = [asking.post(f"{API}/evaluations", json=SMALL).json()["id"] for _ in range(2)]
        refused = asking.post(f"{API}/evaluations", json=SMALL)
        batch = asking.post(f"{API}/batches", json={"items": [SMALL]}).json()["items"]
        kept = asking.get(f"{API}/evaluations").json()["items"]
        asking.post(f"{API}/evaluations/{ids[0]}/cancellation")
        again = asking.post(f"{API}/evaluations", json=SMALL)
        used = asking.get(f"{API}/me").json()["quotas"]["attempts"]
        free = visitor(app, token_of(app, "maintainer"))
        unbound = [free.post(f"{API}/evaluations", json=SMALL).status_code for _ in range(3)]

    assert (refused.status_code, problem_of(refused)["code"]) == (429, "quota_attempts")
    assert 86000 < int(refused.headers["retry-after"]) <= 86400
    assert [item["status"] for item in batch] == [429]
    assert len(kept) == 2
    assert again.status_code == 202
    assert used == {"used": 2, "limit": 2}
    assert unbound == [202] * 3


def test_a_checkpoint_stays_where_the_quota_has_no_room_for_its_first_run(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from tests.seek_model.checkpoints import tiny_checkpoint

    content = tiny_checkpoint(tmp_path / "tiny.safetensors").read_bytes()
    with peopled(tmp_path, quota_attempts=1, smoke=True) as app:
        asking = visitor(app, token_of(app, "submitter"))
        upload = f"{API}/policies/checkpoints"
        first = asking.post(upload, params={"name": "first"}, content=content)
        second = asking.post(upload, params={"name": "second"}, content=content)
        tried = asking.get(f"{API}/evaluations/{first.json()['smoke']}").json()
        known = asking.get(f"{API}/policies").json()["items"]

    assert (first.status_code, second.status_code) == (201, 201)
    assert (tried["policy"], tried["covers"], tried["episodes"]) == ("first", "smoke", 1)
    assert second.json()["smoke"] is None
    assert {one["policy"]: one["smoke"] for one in known[:2]} == {
        "second": None,
        "first": first.json()["smoke"],
    }


def test_what_infrastructure_spoiled_is_given_back_and_a_day_passes(tmp_path: Path) -> None:
    with peopled(tmp_path, quota_attempts=1) as app:
        hub, asking = app.state.hub, visitor(app, token_of(app, "submitter"))
        id = asking.post(f"{API}/evaluations", json=SMALL).json()["id"]
        with hub.database.writing() as session:
            while shard := lifecycle.next_shard(session):
                lifecycle.fail_shard(session, shard, "no GPU")
        spoiled = asking.post(f"{API}/evaluations", json=SMALL)
        assert asking.get(f"{API}/evaluations/{id}").json()["state"] == "incomplete"
        assert asking.post(f"{API}/evaluations", json=SMALL).status_code == 429
        with hub.database.writing() as session:
            for row in session.query(Evaluation):
                row.created -= timedelta(hours=25)

        later = asking.post(f"{API}/evaluations", json=SMALL)

    assert (spoiled.status_code, later.status_code) == (202, 202)


def test_scored_evaluations_have_a_quota_of_their_own(tmp_path: Path) -> None:
    with peopled(tmp_path, quota_scored=1) as app:
        asking = visitor(app, token_of(app, "submitter"))
        whole = {"policy": "noop"}
        statuses = [
            asking.post(f"{API}/evaluations", json=wanted).status_code
            for wanted in (whole, whole, SMALL, whole | {"split": "val"}, whole | {"episodes": 24})
        ]
        quotas = asking.get(f"{API}/me").json()["quotas"]

    assert statuses == [202, 429, 202, 202, 202]
    assert quotas["scored"] == {"used": 1, "limit": 1}
    assert len(SUITES["hide"]) > 1


def test_an_administrator_sets_a_users_own_quota(tmp_path: Path) -> None:
    with peopled(tmp_path, quota_attempts=0) as app:
        admin, asking = (visitor(app, token_of(app, name)) for name in ("admin", "submitter"))
        assert asking.post(f"{API}/evaluations", json=SMALL).status_code == 429

        admin.post(f"{API}/users/submitter/changes", json={"attempts": 1})

        assert asking.post(f"{API}/evaluations", json=SMALL).status_code == 202
        assert asking.post(f"{API}/evaluations", json=SMALL).status_code == 429


def test_too_large_a_checkpoint_for_the_quota_is_refused_before_it_comes(tmp_path: Path) -> None:
    with peopled(tmp_path, quota_storage=100) as app:
        asking = visitor(app, token_of(app, "submitter"))

        answer = asking.post(f"{API}/policies/checkpoints?name=big", content=b"x" * 101)

        assert (answer.status_code, problem_of(answer)["code"]) == (413, "quota_storage")


def test_each_file_counts_once_for_its_owner(app: FastAPI) -> None:
    hub = app.state.hub
    ledgers.uploaded(hub.database, hub.blobs, "seek", b"weights")
    ledgers.uploaded(hub.database, hub.blobs, "same", b"weights")
    ledgers.uploaded(hub.database, hub.blobs, "more", b"other weights")
    with hub.database.writing() as session:
        owner = users.find(session, "submitter").id
        session.execute(
            text("UPDATE policies SET owner_id = :id WHERE name != 'noop'"), {"id": owner}
        )

    used = visitor(app, token_of(app, "submitter")).get(f"{API}/me").json()["quotas"]["storage"]

    assert used["used"] == len(b"weights") + len(b"other weights")


def test_a_rate_is_kept_to_by_user_and_by_address(tmp_path: Path) -> None:
    with peopled(tmp_path, rate="3/hour", rate_unknown="2/hour") as app:
        asking, other = (visitor(app, token_of(app, name)) for name in ("viewer", "admin"))
        stranger = visitor(app)

        known = [asking.get(f"{API}/tasks").status_code for _ in range(4)]
        unknown = [stranger.get(f"{API}/tasks").status_code for _ in range(3)]
        last = asking.get(f"{API}/tasks")

        assert known == [200, 200, 200, 429]
        assert unknown == [401, 401, 429]
        assert 0 < int(last.headers["retry-after"]) <= 3601
        assert other.get(f"{API}/tasks").status_code == 200


def test_guessing_a_password_is_slow(tmp_path: Path) -> None:
    with peopled(tmp_path, rate_sign_in="2/hour") as app:
        with_password(app, "viewer")
        browser = visitor(app)
        csrf = form_of(browser.get("/login").text)
        sent = {"csrf": csrf, "name": "viewer"}
        guesses = [browser.post("/login", data=sent | {"password": "x"}) for _ in range(2)]

        right = browser.post("/login", data=sent | {"password": PASSWORD})

    assert [one.status_code for one in guesses] == [401, 401]
    assert right.status_code == 429 and right.headers["retry-after"]


@pytest.mark.parametrize(("path", "name"), [("users", "name"), ("tokens", "id")])
def test_users_and_tokens_come_in_pages(app: FastAPI, path: str, name: str) -> None:
    for _ in range(3):
        asking = visitor(app, token_of(app, "admin"))
    whole = asking.get(f"{API}/{path}", params={"limit": 200}).json()
    first = asking.get(f"{API}/{path}", params={"limit": 2}).json()

    rest = asking.get(f"{API}/{path}", params={"limit": 200, "cursor": first["next"]}).json()

    assert whole["next"] is None and len(first["items"]) == 2
    told = [one[name] for one in first["items"] + rest["items"]]
    assert told == [one[name] for one in whole["items"]]
    assert len(told) == len(set(told)) > 2


# --- what is kept of it ---


def test_what_was_changed_and_refused_is_kept_for_ever(app: FastAPI) -> None:
    asking, admin = (visitor(app, token_of(app, name)) for name in ("submitter", "admin"))
    id = asking.post(f"{API}/evaluations", json=SMALL).json()["id"]
    asking.post(f"{API}/evaluations", json={"policy": "nobody"})  # wrong: nothing was changed
    asking.get(f"{API}/users")
    asking.get(f"{API}/tasks")

    entries = admin.get(f"{API}/audit", params={"user": "submitter"}).json()["items"]

    told = [(one["action"], one["subject"], one["status"]) for one in entries]
    assert told == [
        ("list_users", f"{API}/users", 403),
        ("create_evaluation", f"{API}/evaluations/{id}", 202),
    ]
    assert all(one["via"].startswith("token ") and one["address"] for one in entries)
    for statement in ("UPDATE audit_entries SET name = 'x'", "DELETE FROM audit_entries"):
        with (
            pytest.raises(IntegrityError, match="audit entries are immutable"),
            app.state.hub.database.writing() as session,
        ):
            session.execute(text(statement))


def test_tries_to_sign_in_are_kept_without_the_password(app: FastAPI) -> None:
    with_password(app, "viewer")
    browser = visitor(app)
    csrf = form_of(browser.get("/login").text)
    browser.post("/login", data={"csrf": csrf, "name": "viewer", "password": "a wrong guess"})
    signed_in(app, "viewer")

    admin = visitor(app, token_of(app, "admin"))
    answer = admin.get(f"{API}/audit", params={"user": "viewer"})

    assert [one["status"] for one in answer.json()["items"]] == [303, 401]
    assert "guess" not in answer.text and PASSWORD not in answer.text


# --- users ---


def test_administrators_add_users_and_one_stays(app: FastAPI) -> None:
    admin = visitor(app, token_of(app, "admin"))

    made = admin.post(f"{API}/users", json={"name": "ann", "role": "viewer", "password": PASSWORD})
    taken = admin.post(f"{API}/users", json={"name": "ann", "role": "viewer"})
    short = admin.post(f"{API}/users", json={"name": "b", "role": "viewer", "password": "short"})
    last = admin.post(f"{API}/users/admin/changes", json={"role": "viewer"})
    owner = admin.post(f"{API}/users/owner/changes", json={"password": PASSWORD})

    assert (made.status_code, made.json()["has_password"]) == (201, True)
    assert [one.status_code for one in (taken, short, last, owner)] == [422, 422, 409, 409]
    assert admin.get(f"{API}/users/b").status_code == 404
    assert admin.get(f"{API}/users/admin").json()["role"] == "admin"
    assert signed_in(app, "ann").get(f"{API}/me").json()["role"] == "viewer"
    with app.state.hub.database.reading() as session:
        kept = session.query(User).filter_by(name="ann").one().password_hash
    assert kept.startswith("$argon2id$") and PASSWORD not in kept


# --- local mode ---


def test_the_printed_token_is_the_owners(tmp_path: Path) -> None:
    app = application(tmp_path, token=True)
    hub = app.state.hub
    link = hub.entrance
    assert hub.local_token in link
    browser, program = visitor(app), visitor(app, hub.local_token)

    assert program.get(f"{API}/me").json()["name"] == "owner"
    assert visitor(app).get(f"{API}/tasks").status_code == 401
    assert browser.get(link.replace(hub.local_token, "hide_local_" + "x" * 43)).status_code == 401
    answer = browser.get(link.removeprefix(hub.address))
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    assert browser.get("/evaluations").status_code == 200
    assert browser.post(f"{API}/evaluations", json=SMALL).status_code == 403
    csrf = {"X-CSRF-Token": form_of(browser.get("/account").text)}
    assert browser.post(f"{API}/evaluations", json=SMALL, headers=csrf).status_code == 202
    hub.stop()


def test_a_wrong_token_is_refused_even_where_none_is_asked_for(tmp_path: Path) -> None:
    app = application(tmp_path)

    assert visitor(app).get(f"{API}/me").json()["via"] == "local"
    assert visitor(app, "hide_local_" + "x" * 43).get(f"{API}/me").status_code == 401
    token = token_of(app, "owner", [Scope.READ])
    assert visitor(app, token).post(f"{API}/evaluations", json=SMALL).status_code == 403
    assert visitor(app).get("/login").headers["location"] == "/"
    app.state.hub.stop()


@pytest.mark.parametrize(
    ("given", "open", "asks", "beyond"),
    [
        ({}, True, False, False),
        ({"token": True}, False, True, False),
        ({"auth": "users"}, False, False, False),
        ({"host": "192.0.2.7"}, False, True, True),
        ({"public_url": "https://lab.example.org"}, False, True, True),
        ({"host": "0.0.0.0", "auth": "users"}, False, False, True),
    ],
)
def test_who_is_let_in_follows_from_who_can_come(
    given: dict[str, object], open: bool, asks: bool, beyond: bool
) -> None:
    settings = Settings(**given)

    assert (settings.is_open, settings.asks_token, settings.beyond) == (open, asks, beyond)


def test_the_public_name_is_a_host_and_no_other_is(tmp_path: Path) -> None:
    app = application(tmp_path, auth="users", public_url="https://Lab.example.org:8443")
    asking = visitor(app)

    for host, status in {
        "lab.example.org:8443": 200,
        "127.0.0.1": 200,
        "evil.example": 421,
    }.items():
        assert asking.get(f"{API}/version", headers={"Host": host}).status_code == status
    app.state.hub.stop()
