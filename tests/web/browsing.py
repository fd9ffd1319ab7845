"""A browser's pages on a server of the tests' own."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import uvicorn
from fastapi import FastAPI
from playwright.sync_api import Browser, Page, Request

WIDTHS = {"desk": 1440, "phone": 390}


@contextmanager
def serving(app: FastAPI) -> Iterator[str]:
    """The application on a port of its own; its address."""
    server = uvicorn.Server(uvicorn.Config(app, log_config=None, timeout_graceful_shutdown=1))
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            while not server.started:  # what runs before that is taken back
                assert thread.is_alive(), "the server did not start"
                time.sleep(0.01)
            yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        finally:
            app.state.hub.bell.close()
            server.should_exit = True
            thread.join(timeout=20)


@contextmanager
def opened(browser: Browser, address: str, width: int = 1000, **options: Any) -> Iterator[Page]:
    """A page that may neither complain nor ask anybody else."""
    context = browser.new_context(viewport={"width": width, "height": 800}, **options)
    page = context.new_page()
    complaints: list[str] = []

    def asked(request: Request) -> None:
        if not request.url.startswith((address, "data:")):
            complaints.append(f"asked {request.url}")

    page.on("console", lambda said: said.type == "error" and complaints.append(said.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", asked)
    try:
        yield page
        assert complaints == []
    finally:
        context.close()


def until(page: Page, condition: str, seconds: float = 90) -> Any:
    """What an expression gives as soon as it gives something; a CSP forbids wait_for_function."""
    deadline = time.monotonic() + seconds
    while not (found := page.evaluate(condition)):
        assert time.monotonic() < deadline, f"{condition} did not come true in {seconds:.0f} s"
        page.wait_for_timeout(100)
    return found
