"""The pages of people and of the audit log: for administrators alone."""

from collections.abc import Iterator
from html import unescape

import pytest
from fastapi import FastAPI

from server.access import Role
from tests.server.clients import API, TestClient
from tests.server.people import form_of, peopled, signed_in, token_of, visitor, with_password

PATH = "/people"


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FastAPI]:
    with peopled(tmp_path_factory.mktemp("people"), rate="100000/minute") as found:
        with_password(found, "admin")
        yield found


@pytest.fixture(scope="module")
def admin(app: FastAPI) -> TestClient:
    return signed_in(app, "admin")


def sent(admin: TestClient, path: str, **fields: object):
    csrf = form_of(admin.get(PATH).text)
    return admin.post(f"{PATH}{path}", data={"csrf": csrf, **fields})


def test_somebody_is_added_given_a_role_shut_out_and_let_in(admin: TestClient) -> None:
    person = f"{API}/users/ann"

    assert sent(admin, "", name="ann", role="viewer").headers["location"] == PATH
    assert "ann" in admin.get(PATH).text
    sent(admin, "/ann/changes", role="maintainer")
    assert admin.get(person).json()["role"] == "maintainer"
    sent(admin, "/ann/changes", active="false")
    assert admin.get(person).json()["active"] is False
    assert "nothing: shut out" in admin.get(PATH).text
    sent(admin, "/ann/changes", active="true")

    assert (admin.get(person).json()["role"], admin.get(person).json()["active"]) == (
        "maintainer",
        True,
    )


def test_what_is_wrong_is_said_and_changes_nothing(admin: TestClient) -> None:
    before = admin.get(f"{API}/users").json()

    answers = [
        sent(admin, "", name="no spaces", role="viewer"),
        sent(admin, "", name="viewer", role="viewer"),
        sent(admin, "", name="bob", role="viewer", password="short"),
        sent(admin, "/admin/changes", role="viewer"),
    ]

    assert [one.status_code for one in answers] == [422, 422, 422, 409]
    said = [unescape(one.text.partition('role="alert">')[2].partition("<")[0]) for one in answers]
    assert "taken" in said[1] and "5 characters" in said[2] and "administer" in said[3]
    assert 'value="no spaces"' in answers[0].text
    names = [one["name"] for one in admin.get(f"{API}/users").json()["items"]]
    assert names == [one["name"] for one in before["items"]]


def test_the_log_tells_what_was_changed_and_by_whom(app: FastAPI, admin: TestClient) -> None:
    reader = visitor(app, token_of(app, "viewer"))
    reader.get(PATH)
    sent(admin, "", name="carl", role="viewer")

    every, readers = (admin.get(f"{PATH}/audit{asked}").text for asked in ("", "?user=viewer"))

    assert "add person" in every and "list people" in every
    assert "list people" in readers and "add person" not in readers
    assert '<b class="bad">403</b>' in readers


@pytest.mark.parametrize("role", [role for role in Role if role is not Role.ADMIN])
def test_others_see_none_of_it(app: FastAPI, role: Role) -> None:
    other = visitor(app, token_of(app, role.value))

    assert other.get(PATH).status_code == other.get(f"{PATH}/audit").status_code == 403
    assert f'href="{PATH}"' not in other.get("/account").text
