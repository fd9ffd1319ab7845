"""One filled site for all tests of pages: they read, and change nothing."""

import warnings
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, sync_playwright

from tests.chromium import CHROMIUM, FLAGS
from tests.web import sites
from tests.web.browsing import serving

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # Starlette would rather have another HTTP library
    from fastapi.testclient import TestClient


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[sites.Site]:
    """The application with evaluations in every state."""
    app = sites.empty(tmp_path_factory.mktemp("site"))
    found = sites.filled(app, tmp_path_factory.mktemp("recordings"))
    yield found
    found.hub.stop()


@pytest.fixture
def client(site: sites.Site) -> TestClient:
    """A client of the site; what the server raises becomes its answer."""
    return TestClient(site.app, base_url="http://127.0.0.1", raise_server_exceptions=False)


@pytest.fixture(scope="session")
def every_suite(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """A client of an application with whole evaluations of `mine` and `expert` of every suite."""
    app = sites.of_every_suite(tmp_path_factory.mktemp("suites"))
    yield TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False)
    app.state.hub.stop()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield started
        started.close()


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[sites.Site, str]]:
    """A filled site of a module's own, for tests that change it, and its address."""
    app = sites.empty(tmp_path_factory.mktemp("site"))
    with serving(app) as address:
        yield sites.filled(app, tmp_path_factory.mktemp("recordings")), address
