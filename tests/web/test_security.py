"""Headers: what a page may do, and how long its files may be kept."""

import re
import subprocess
import sys
from pathlib import Path

from fastapi.testclient import TestClient

from tests.web.sites import Site
from web.security import HEADERS, STRICT, VIEWER

ROOT = Path(__file__).parents[2]


def test_only_the_page_of_an_episode_may_run_webassembly(client: TestClient, site: Site) -> None:
    [id] = site.episodes(site.recorded)

    for path in ("/", "/evaluations", f"/evaluations/{site.running}", "/tasks", "/nowhere"):
        assert client.get(path).headers["content-security-policy"] == STRICT
    assert client.get(f"/episodes/{id}").headers["content-security-policy"] == VIEWER
    assert "wasm" not in STRICT and "unsafe" not in STRICT


def test_every_answer_has_the_other_headers(client: TestClient, site: Site) -> None:
    [id] = site.episodes(site.recorded)
    recording = f"/api/v1/episodes/{id}/recording.rrd"

    for path in ("/", "/nowhere", "/api/v1/tasks", "/static/css/base.css", recording):
        headers = client.get(path).headers
        assert {name: headers.get(name) for name in HEADERS} == HEADERS, path


def test_a_file_with_its_hash_is_kept_for_ever_and_another_is_asked_for(client: TestClient) -> None:
    [hashed] = set(re.findall(r'href="(/static/css/base\.css\?v=\w+)"', client.get("/").text))

    kept, stale = client.get(hashed), client.get("/static/css/base.css?v=old")
    again = client.get("/static/css/base.css", headers={"If-None-Match": stale.headers["etag"]})

    assert "immutable" in kept.headers["cache-control"]
    assert stale.headers["cache-control"] == "no-cache"
    assert again.status_code == 304


def test_nothing_outside_the_static_folder_is_given_out(client: TestClient) -> None:
    for path in ("/static/../app.py", "/static/%2e%2e/app.py", "/static/"):
        assert client.get(path).status_code == 404


def test_the_application_with_its_pages_starts_light(tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from server.settings import Settings\n"
        "from web.app import create_app\n"
        f"app = create_app(Settings(data=Path({str(tmp_path / 'data')!r}), workers=0))\n"
        "heavy = {'rerun', 'rerun_notebook', 'IPython', 'pybullet', 'numba', 'torch'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "app.state.hub.stop()"
    )

    subprocess.run([sys.executable, "-c", program], check=True, cwd=ROOT, timeout=60)
