"""Pages, rendered from a real ledger: what stands on them and where they lead."""

import hashlib
import json
import re
from collections import defaultdict
from html import unescape
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from hide_tasks import ALL_TASKS, SUITES, load
from hide_tasks.certificates import committed
from hide_tasks.contract import Failure
from seek_model import trained
from server import checkpoints, policies, snapshots, uploads
from server.states import EpisodeState
from tests.server import ledgers, people
from tests.web import sites
from tests.web.sites import Site
from tests.workers import checkpoint_files
from web.wording import FAILURES, OUTCOMES, words

WHOLE = ["/", "/?verdict=exact", "/?split=val", "/evaluations", "/evaluations/new", "/tasks"]
WHOLE += ["/tasks?suite=hide-hard", "/tasks?suite=real4"]
WHOLE += ["/policies/mine", "/policies/expert@1", "/batches", "/snapshots", "/snapshots/1"]
WHOLE += ["/snapshots/1?verdict=exact", "/comparisons", "/comparisons?a=mine&b=expert"]
WHOLE += ["/ablations", "/ablations?size=paper&clock=true&verdict=exact"]
WHOLE += ["/account", "/account/webhooks"]
STATES = ["completed", "running", "queued", "incomplete", "cancelled", "recorded"]


def page(client: TestClient, path: str, status: int = 200) -> str:
    """The text of a page."""
    response = client.get(path)
    assert response.status_code == status, response.text[:2000]
    assert response.headers["content-type"].startswith("text/html")
    return response.text


def links(text: str) -> list[str]:
    """Where a page leads."""
    return [unescape(one) for one in re.findall(r'href="([^"]+)"', text)]


def every_page(site: Site) -> list[str]:
    """A path of every page in every state."""
    paths = WHOLE + [f"/tasks/{name}" for name in ALL_TASKS]
    for state in STATES:
        evaluation = getattr(site, state)
        paths += [f"/evaluations/{evaluation}", f"/evaluations/{evaluation}/failures"]
    for state in EpisodeState:
        paths.append(f"/episodes/{site.episodes(site.running, state=state)[0]}")
    paths += [f"/policies/{site.checkpoint}", f"/batches/{site.batch}"]
    paths += [f"/account/webhooks/{site.webhook}"]
    paths += [f"/episodes/{id}" for id in site.episodes(site.recorded)]
    paths += [
        f"/episodes/{site.episodes(site.completed, failure=failure)[0]}" for failure in Failure
    ]
    return paths


def test_every_page_is_whole_in_every_state(client: TestClient, site: Site) -> None:
    for path in every_page(site):
        text = page(client, path)

        assert text.rstrip().endswith("</html>")
        assert re.search(r"<title>\S.* · HIDE-SEEK</title>", text), path
        assert len(re.findall(r"<h1", text)) == 1, path


def test_every_link_leads_somewhere(client: TestClient, site: Site) -> None:
    [running] = site.episodes(site.running, state=EpisodeState.RUNNING)
    found = {link for path in every_page(site) for link in links(page(client, path))}
    found -= {f"/api/v1/episodes/{running}/recording.rrd"}  # nothing of it has come in
    shapes: dict[str, list[str]] = defaultdict(list)
    for link in sorted(found):
        shapes[re.sub(r"[a-z]{2}_[0-9A-Z]{26}", "id", link)].append(link.partition("#")[0])

    some = {link for alike in shapes.values() for link in alike[:2] if link.startswith("/")}
    broken = [link for link in sorted(some) if client.get(link).status_code != 200]

    assert broken == []


def test_no_page_has_scripts_or_styles_of_its_own(client: TestClient, site: Site) -> None:
    for path in every_page(site):
        text = page(client, path)

        own = re.findall(r"<[^>]* style=|<style|<script(?![^>]* src=)|<[^>]* on[a-z]+=", text)
        assert own == [], path


# --- the leaderboard ---


def test_the_leaderboard_ranks_policies_and_shows_references_apart(client: TestClient) -> None:
    text = page(client, "/")

    places = [text.index(part) for part in (">mine<", "Reference policies", ">expert<")]
    assert places == sorted(places)
    assert "best without memory" in text
    assert all(f'href="/tasks/{name}"' in text for name in SUITES["hide"])


def test_a_cell_of_the_leaderboard_leads_to_its_episodes(client: TestClient, site: Site) -> None:
    [cell] = [
        link
        for link in links(page(client, "/"))
        if site.completed in link and "task=search_drawer" in link
    ]

    text = page(client, cell)

    wanted = site.episodes(site.completed, task="search_drawer")
    assert text.count('class="card"') == len(wanted)


def test_the_verdict_that_ranks_is_switched_in_the_address(client: TestClient) -> None:
    assert '"/?verdict=exact"' in page(client, "/")
    assert '<a href="/?verdict=exact" aria-current="true">' in page(client, "/?verdict=exact")


def test_an_empty_leaderboard_tells_what_to_do(tmp_path: Path) -> None:
    app = sites.empty(tmp_path)

    text = page(TestClient(app, base_url="http://127.0.0.1"), "/")

    app.state.hub.stop()
    assert "No complete evaluation" in text
    assert 'href="/evaluations/new"' in text


# --- evaluations ---


def test_evaluations_are_filtered_by_the_address(client: TestClient, site: Site) -> None:
    text = page(client, "/evaluations?state=incomplete&policy=")

    found = {link for link in links(text) if link.startswith("/evaluations/ev")}
    assert found == {f"/evaluations/{site.incomplete}"}


def test_the_grid_shows_every_episode_without_a_script(client: TestClient, site: Site) -> None:
    text = page(client, f"/evaluations/{site.completed}")

    for kind, wanted in {
        "exact": {"exact": True},
        "success": {"success": True, "exact": False},
        "failed": {"success": False},
    }.items():
        cells = re.findall(rf'id="cell-[^"]+" class="cell {kind}"', text)
        assert len(cells) == len(site.episodes(site.completed, **wanted))


def test_an_evaluation_says_why_it_waits_and_what_was_lost(client: TestClient, site: Site) -> None:
    assert "started without workers" in page(client, f"/evaluations/{site.queued}")
    assert "Attempts that were lost" in page(client, f"/evaluations/{site.incomplete}")
    assert "killed (SIGKILL)" in page(client, f"/evaluations/{site.incomplete}")


def test_only_what_can_be_resumed_or_cancelled_offers_it(client: TestClient, site: Site) -> None:
    offered = {
        state: set(re.findall(r'data-send="(\w+)"', page(client, f"/evaluations/{id}")))
        for state in STATES
        if (id := getattr(site, state))
    }

    assert offered["running"] == offered["queued"] == {"cancellation"}
    assert offered["incomplete"] == {"resumption"}
    assert offered["completed"] == offered["cancelled"] == set()


def test_the_form_offers_every_policy_and_task(client: TestClient) -> None:
    text = page(client, "/evaluations/new?policy=mine")

    assert '<option value="mine@1" selected>' in text
    assert all(f'name="tasks" value="{name}"' in text for name in ALL_TASKS)


def test_of_a_name_the_newest_version_is_chosen(client: TestClient, site: Site) -> None:
    ledgers.registered(site.hub.database, "twice")
    newest = ledgers.registered(site.hub.database, "twice")

    for named in ("twice", "twice@2", newest):
        assert re.findall(
            r'value="([^"]+)" selected', page(client, f"/evaluations/new?policy={named}")
        ) == ["twice@2"]


def test_a_checkpoint_is_shown_with_its_model_size_and_hash(client: TestClient) -> None:
    text = page(client, "/evaluations/new")

    assert '<option value="seek@1">seek@1 (checkpoint, seek-small)</option>' in text
    row = text[text.index("seek<span") :]
    sha256 = hashlib.sha256(b"weights").hexdigest()
    assert row.index("<td>checkpoint</td>") < row.index("seek-small") < row.index("7\u202fbytes")
    assert f'title="SHA-256 {sha256}">{sha256[:12]}<' in row


def test_the_form_of_an_upload_knows_what_is_refused(client: TestClient, site: Site) -> None:
    text = page(client, "/evaluations/new?upload=true")

    assert 'value="upload" data-first="Upload it first" checked' in text
    assert f'data-limit="{site.hub.settings.checkpoint_limit}"' in text
    assert "(?!(expert|amnesiac|random|noop|seek-small|sam2act-small)$)" in text


# --- policies ---


def test_a_policy_says_what_was_tried_of_it_and_how_it_did(client: TestClient, site: Site) -> None:
    text = page(client, f"/policies/{site.checkpoint}")

    steps = re.findall(r'<li class="(\w+)"><b>([^<]+)</b> <span>([^<]+)</span>', text)
    assert [step[0] for step in steps] == ["passed", "passed", "noted"]
    assert steps[1][1:] == (
        "loaded in the sandbox: names, shapes, numbers",
        "passed in 3.42\u202fs",
    )
    assert "seek-small, 214 tensors" in text and sites.NASTY in unescape(text)
    assert hashlib.sha256(b"weights").hexdigest() in text
    assert f'href="/evaluations/{site.completed}"' in page(client, "/policies/mine")


@pytest.mark.parametrize("named", ["seek", "seek@1"])
def test_a_policy_is_found_by_its_name(client: TestClient, named: str) -> None:
    assert '<h1>seek<span class="version">@1</span></h1>' in page(client, f"/policies/{named}")


def test_uploads_that_are_not_done_are_offered_again(client: TestClient, site: Site) -> None:
    hub = site.hub
    with hub.database.writing() as session:
        about = {"name": "far", "description": "", "sha256": "0" * 64}
        part, whole = (
            uploads.create(session, hub.owner.user, length=n, **about) for n in (100, 40)
        )
    try:
        for row in (part, whole):
            hub.uploads.of(row.id).path.write_bytes(b"x" * 40)

        text = page(client, "/evaluations/new")

        assert 'value="upload" data-first="Upload it first" checked' in text
        for row, button in ((part, "choose"), (whole, "finish")):
            offered = text.partition(f'data-upload="{row.id}"')[2].partition("</li>")[0]
            found = re.findall(r'data-unfinished="(\w+)"', offered)
            assert found == [button, "forget"]

        hub.uploads.of(part.id).path.write_bytes(b"x" * 100)
        all_came = page(client, "/evaluations/new")
        assert 'value="here" checked' in all_came and all_came.count("data-upload=") == 2
    finally:
        for row in (part, whole):
            client.delete(f"/api/v1/uploads/{row.id}", headers={"Tus-Resumable": "1.0.0"})


# --- batches, comparisons, snapshots ---


def test_a_batch_shows_what_was_accepted_refused_and_broken_off(
    client: TestClient, site: Site
) -> None:
    text = unescape(page(client, f"/batches/{site.batch}"))

    assert len(re.findall(r'href="/evaluations/ev_', text)) == 1
    assert f"policy: no policy '{sites.NASTY}'" in text
    assert "of 1 nothing has become" in text
    assert f'href="/batches/{site.batch}"' in page(client, "/batches")


def test_a_comparison_shows_the_figures_of_the_api(client: TestClient) -> None:
    path = "/comparisons?a=mine&b=expert&verdict=exact"
    found = client.get(f"/api/v1{path}").json()

    text = page(client, path)

    counts = found["overall"]["table"]
    row = text.partition("all 15</th>")[2].partition("</tr>")[0]
    assert all(f"{counts[one] or '<td>0'}</" in row for one in ("only_a", "only_b"))
    assert f"<b>{100 * found['overall']['difference']:+.0f}</b>".replace("-", "−") in row
    for one in found["discordant"][:3]:
        failed, managed = (one["b"], one["a"]) if one["better"] == "a" else (one["a"], one["b"])
        assert f'href="/episodes/{failed}?beside={managed}"' in text
    differences = text.partition('class="list differences"')[2].partition("</table>")[0]
    assert differences.count('<tr><th scope="row"><abbr class="category') == len(SUITES["hide"])


@pytest.mark.parametrize(
    ("asked", "status", "said"),
    [("a=mine&b=nobody", 422, "no policy 'nobody'"), ("a=mine&b=late", 422, "has no completed")],
)
def test_what_cannot_be_compared_is_said_beside_the_form(
    client: TestClient, asked: str, status: int, said: str
) -> None:
    text = unescape(page(client, f"/comparisons?{asked}", status))

    assert said in text
    assert 'name="policy" value="mine"' in text


def test_a_snapshot_shows_what_was_kept_and_its_hash(client: TestClient, site: Site) -> None:
    with site.hub.database.reading() as session:
        row = snapshots.find(session, "1")
    kept = json.loads(row.content)["leaderboards"]["success"]["rows"]

    text = page(client, "/snapshots/1")

    assert row.sha256 in text
    assert all(f'href="/evaluations/{one["evaluation"]}"' in text for one in kept)
    assert sites.NASTY not in text and sites.NASTY in unescape(text)
    [content] = [link for link in links(text) if link.endswith("/content.json")]
    assert hashlib.sha256(client.get(content).content).hexdigest() == row.sha256


def test_the_leaderboard_is_kept_by_a_form_and_twice_is_once(client: TestClient) -> None:
    answers = [
        client.post("/snapshots", data={"split": "test"}, follow_redirects=False) for _ in range(2)
    ]
    empty = client.post("/snapshots", data={"split": "train"})
    wrong = client.post("/snapshots", data={"suite": "full"})

    assert {one.status_code for one in answers} == {303}
    assert len({one.headers["location"] for one in answers}) == 1
    assert empty.status_code == 409 and "No policy has a whole evaluation" in empty.text
    assert wrong.status_code == 422 and "hide, hide-hard, real4" in wrong.text


# --- failures ---


def test_every_failure_is_one_click_from_its_replay(client: TestClient, site: Site) -> None:
    text = page(client, f"/evaluations/{site.completed}/failures")
    shown = shown_on(text)
    while more := re.search(r'href="([^"]+)" rel="next"', text):
        text = page(client, unescape(more[1]).partition("#")[0])
        shown |= shown_on(text)

    assert shown == set(site.episodes(site.completed, exact=False))


def shown_on(text: str) -> set[str]:
    """Ids of the episodes that are cards of a page."""
    return set(re.findall(r'class="card" data-episode="([^"]+)"', text))


def test_a_count_leads_to_so_many_episodes(client: TestClient, site: Site) -> None:
    text = page(client, f"/evaluations/{site.completed}/failures")
    counts = re.findall(r'<a href="([^"]*failure=[^"]*)#episodes">(\d+)</a>', text)

    assert counts
    for link, count in counts:
        assert page(client, unescape(link)).count('class="card"') == int(count)


def test_a_filter_that_names_nothing_is_refused(client: TestClient, site: Site) -> None:
    text = page(client, f"/evaluations/{site.completed}/failures?failure=bad_luck", 422)

    assert "failure" in text


def test_an_empty_filter_is_none(client: TestClient, site: Site) -> None:
    page(client, f"/evaluations/{site.completed}/failures?failure=&task=&category=&verdict=")


# --- episodes ---


def test_an_episode_says_what_its_failure_means(client: TestClient, site: Site) -> None:
    for failure in Failure:
        [id, *_] = site.episodes(site.completed, failure=failure)

        assert FAILURES[failure] in unescape(page(client, f"/episodes/{id}"))


def test_neighbours_are_those_of_the_filter(client: TestClient, site: Site) -> None:
    first, second, *_ = site.episodes(site.completed, failure=Failure.OVERCOUNT)

    within = f"?failure=overcount&evaluation={site.completed}"
    plain, filtered = (page(client, f"/episodes/{first}{within_it}") for within_it in ("", within))

    assert f"/episodes/{second}{within}" in links(filtered)
    assert f"/episodes/{second}" not in links(plain)
    assert f"/evaluations/{site.completed}/failures?failure=overcount#episodes" in links(filtered)


def test_an_episode_shows_hidden_state_belief_checks_and_decisions(
    client: TestClient, site: Site
) -> None:
    [id] = site.episodes(site.recorded)

    text = page(client, f"/episodes/{id}")

    lanes = ("hidden</small> presses done", "truth</small> stages done", "belief</small> anchor")
    for lane in (*lanes, "check</small>"):
        assert lane in text
    assert 'role="slider"' in text
    assert 'data-recording="/api/v1/episodes/' in text
    assert len(re.findall(r'<tr data-decision="\d+"', text)) == text.count('class="seek"') > 3


def test_a_running_episode_can_be_watched(client: TestClient, site: Site) -> None:
    [id] = site.episodes(site.running, state=EpisodeState.RUNNING)

    assert 'data-live="yes"' in page(client, f"/episodes/{id}")


def test_what_a_policy_says_is_not_markup(client: TestClient, site: Site) -> None:
    [id, *_] = site.episodes(site.running, failure=Failure.POLICY_ERROR)

    text = page(client, f"/episodes/{id}")

    assert sites.NASTY not in text
    assert sites.NASTY in unescape(text)


def test_every_failure_and_every_outcome_has_words() -> None:
    from hide_tasks.contract import MotionOutcome

    assert set(FAILURES) == set(Failure)
    assert set(OUTCOMES) == set(MotionOutcome)


# --- tasks ---


@pytest.mark.parametrize("suite", SUITES)
def test_the_tasks_of_a_suite_are_a_page(client: TestClient, suite: str) -> None:
    text = page(client, "/tasks" if suite == "hide" else f"/tasks?suite={suite}")

    there = {name for name in ALL_TASKS if f'href="/tasks/{name}"' in text}
    assert there == set(SUITES[suite])
    assert "the suites are hide" in page(client, "/tasks?suite=rlbench", 422)


def test_a_tasks_page_says_what_it_is_seen_through(client: TestClient) -> None:
    [seen] = re.findall(r"<dt>cameras</dt><dd>(.*?)</dd>", page(client, "/tasks/real_stack_cups"))
    [four] = re.findall(r"<dt>cameras</dt><dd>(.*?)</dd>", page(client, "/tasks/search_drawer"))

    assert (seen, four) == ("front", "front, left shoulder, right shoulder, wrist")


def test_a_tasks_page_says_what_can_go_wrong_and_how(client: TestClient) -> None:
    text = unescape(page(client, "/tasks/weighing_on_off"))

    for failure, how in load("weighing_on_off").failures.items():
        assert words(failure) in text
        assert how in text


def test_a_task_shows_both_moments_of_every_alias_pair(client: TestClient) -> None:
    for name in SUITES["hide"]:
        text = page(client, f"/tasks/{name}")
        pictures = re.findall(rf'src="(/static/tasks/{name}-alias-\d+-[ab]\.webp)"', text)

        pairs = len(committed(name)["aliases"])
        assert len(set(pictures)) == 2 * pairs
        assert text.count('class="alias"') == (pairs if pairs > 1 else 0)
        assert all(client.get(one).status_code == 200 for one in pictures)


def test_a_checkpoints_page_leads_to_the_run_that_tried_it(client: TestClient) -> None:
    hub = client.app.state.hub
    version = ledgers.uploaded(hub.database, hub.blobs, "tried", b"weights of a new one")
    with hub.database.writing() as session:
        row = policies.find(session, version)
        settings = hub.settings.model_copy(update={"smoke": True})
        tried = checkpoints.try_out(session, row, hub.owner, settings)
        assert tried is not None
        id = tried.id

    assert f"/evaluations/{id}" in links(page(client, f"/policies/{version}"))


# --- what is not there ---


@pytest.mark.parametrize("path", ["/nowhere", "/episodes/none", "/evaluations/none", "/tasks/none"])
def test_what_is_not_there_is_a_page_that_says_so(client: TestClient, path: str) -> None:
    text = page(client, path, 404)

    assert "Not Found" in text
    assert 'href="/evaluations"' in text


def test_the_api_keeps_its_own_errors(client: TestClient) -> None:
    for path in ("/api/v1/nowhere", "/api/v1/episodes/none"):
        response = client.get(path)

        assert response.status_code == 404
        assert response.headers["content-type"] == "application/problem+json"


def test_the_wrong_method_is_a_page_too(client: TestClient) -> None:
    response = client.post("/tasks")

    assert response.status_code == 405
    assert "<h1>" in response.text


def test_what_comes_along_is_named_as_such(tmp_path: Path) -> None:
    (folder := tmp_path / "trained").mkdir()
    checkpoint_files.written(trained.path_of("seek-small", folder), name="seek-small")
    app = people.application(tmp_path / "data", references=True, trained=folder)

    with TestClient(app, base_url="http://127.0.0.1") as client:
        first, form = page(client, "/"), page(client, "/evaluations/new")
        about = page(client, "/policies/seek-small")

    assert "seek-small was trained with this code and comes along" in first
    assert '<option value="seek-small@1">seek-small@1 (trained, comes along)</option>' in form
    assert "It was trained with this code and comes along." in about
    assert trained.ABOUT["seek-small"] in about


def test_without_trained_policies_none_is_named(tmp_path: Path) -> None:
    app = people.application(tmp_path / "data", references=True)

    with TestClient(app, base_url="http://127.0.0.1") as client:
        first = page(client, "/")

    assert "References give a scale" in first and "seek-small" not in first
