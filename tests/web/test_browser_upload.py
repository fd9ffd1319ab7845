"""Uploads from a real browser: cut, paused, left and taken up again; nothing is sent twice."""

import hashlib
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi import FastAPI
from playwright.sync_api import Browser, CDPSession, Page, Request

from server import uploads
from server.models import Upload
from tests.chromium import CHROMIUM
from tests.server.cuts import cut_way
from tests.server.people import application
from tests.web.browsing import WIDTHS, opened, serving
from tests.workers import checkpoint_files

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not CHROMIUM, reason="no chromium: apt-get install chromium"),
]
CONTENT = random.Random(0).randbytes(3_000_000)  # no checkpoint: refused when all of it came
SHA256 = hashlib.sha256(CONTENT).hexdigest()
SLOW = 300_000  # bytes in a second


@pytest.fixture
def app(tmp_path: Path) -> FastAPI:
    return application(tmp_path)


@pytest.fixture
def address(app: FastAPI) -> Iterator[str]:
    with serving(app) as found:
        yield found


def choose(page: Page, content: bytes = CONTENT) -> None:
    """Chooses the file and sends it, by the keyboard."""
    page.set_input_files("#file", {"name": "a.safetensors", "mimeType": "", "buffer": content})
    page.focus("#upload [type=submit]")
    page.keyboard.press("Enter")


def begin(page: Page, address: str, content: bytes = CONTENT) -> None:
    page.goto(f"{address}/evaluations/new?upload=true")
    page.fill("#name", "far")
    choose(page, content)


def offsets(page: Page) -> list[int]:
    """Where each piece begins that the page sends from now on."""
    found: list[int] = []

    def note(request: Request) -> None:
        if request.method == "PATCH":
            found.append(int(request.headers["upload-offset"]))

    page.on("request", note)
    return found


def the_upload(app: FastAPI) -> Upload:
    with app.state.hub.database.reading() as session:
        [row] = session.query(Upload).all()
        return row


def came(app: FastAPI) -> bytes:
    """What the server has of it."""
    content: bytes = app.state.hub.uploads.of(the_upload(app).id).path.read_bytes()
    return content


def throttle(wire: CDPSession, speed: int) -> None:
    """Lets the page send so many bytes in a second; -1: as many as it can."""
    wire.send("Network.enable")
    rule = {"offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": speed}
    wire.send("Network.emulateNetworkConditions", rule)


def test_an_upload_that_is_cut_goes_on_where_it_was(
    app: FastAPI, address: str, browser: Browser
) -> None:
    with cut_way(address, 1_000_000) as way:
        context = browser.new_context()
        page = context.new_page()
        sent = offsets(page)

        begin(page, way.url)
        page.wait_for_selector("#upload [role=alert]:visible", timeout=120_000)

        assert way.cuts >= 1
        assert len(sent) >= 2 and sent[0] == 0 and 0 < sent[-1] < len(CONTENT)
        assert sent == sorted(sent)
        assert came(app) == CONTENT
        assert the_upload(app).sha256 == SHA256
        assert SHA256 in page.inner_text("[data-hash]")
        assert "no safetensors file" in page.inner_text("#file-error")
        context.close()


def test_an_upload_is_paused_left_and_taken_up_by_another_page(
    app: FastAPI, address: str, browser: Browser
) -> None:
    context = browser.new_context(viewport={"width": WIDTHS["phone"], "height": 800})
    page = context.new_page()
    page.on("dialog", lambda dialog: dialog.accept())
    wire = context.new_cdp_session(page)
    throttle(wire, SLOW)
    begin(page, address)
    page.wait_for_selector("#upload [role=status]:has-text('Sending')", timeout=120_000)
    page.wait_for_timeout(1500)

    page.click("text=Pause")
    page.wait_for_selector("#upload [role=status]:has-text('Paused')")
    assert page.evaluate("document.activeElement.textContent") == "Go on"
    page.reload()
    throttle(wire, -1)
    had = len(came(app))
    sent = offsets(page)
    page.click("#unfinished [data-unfinished=choose]")
    assert page.input_value("#name") == "far"
    assert page.evaluate("document.activeElement.id") == "file"
    choose(page)
    page.wait_for_selector("#upload [role=alert]:visible", timeout=120_000)

    assert 0 < had < len(CONTENT)
    assert sent[0] >= had
    assert came(app) == CONTENT
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    context.close()


def test_another_file_is_not_taken_for_the_one_that_was_begun(
    app: FastAPI, address: str, browser: Browser
) -> None:
    hub = app.state.hub
    with hub.database.writing() as session:
        begun = {"length": len(CONTENT), "name": "far", "description": "", "sha256": SHA256}
        uploads.create(session, hub.owner.user, **begun)
    with opened(browser, address) as page:
        page.goto(f"{address}/evaluations/new")
        page.click("#unfinished [data-unfinished=choose]")
        choose(page, CONTENT[::-1])
        page.wait_for_selector("#upload [role=alert]:visible", timeout=120_000)

        assert f"whose SHA-256 is {SHA256[:12]}" in page.inner_text("#file-error")
        assert the_upload(app).sha256 == SHA256
        page.click("#unfinished [data-unfinished=forget]")
        page.wait_for_selector("#unfinished", state="hidden")
        with hub.database.reading() as session:
            assert session.query(Upload).count() == 0


def test_a_refusal_shows_every_step_and_why(address: str, browser: Browser) -> None:
    context = browser.new_context()
    page = context.new_page()

    begin(page, address, checkpoint_files.content())
    page.wait_for_selector("#upload .checks li.failed", timeout=240_000)

    steps = page.locator("#upload .checks li")
    assert [steps.nth(n).get_attribute("class") for n in range(3)] == ["passed", "passed", "failed"]
    assert steps.count() == 3
    assert "SHA-256 of what came is the sender's" in steps.nth(0).inner_text()
    assert "tensor " in steps.nth(2).inner_text()
    assert "cannot be loaded" in page.inner_text("#file-error")
    context.close()
