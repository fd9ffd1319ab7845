"""The drawing of an episode's hidden state: every value in its lane, at its time."""

import re
from xml.etree import ElementTree

from hide_tasks.contract import Event, Failure
from server.schemas.episodes import DecisionPublic, SpanPublic
from tests.web.sites import Site
from web.charts import element, progress_bar, rate_bar
from web.routes_episodes import rows_of
from web.timeline import Timeline


def timeline_of(site: Site, **changes: object) -> Timeline:
    """Of an overcount in the ledger, with changes to its last decision."""
    from server import episodes

    [id, *_] = site.episodes(site.completed, failure=Failure.OVERCOUNT)
    with site.hub.database.reading() as session:
        decisions = episodes.decisions(session, id)
        last = decisions[-1].model_copy(update=changes)
        return Timeline(
            episodes.get(session, id), [*decisions[:-1], last], episodes.spans(session, id)
        )


def test_lanes_are_hidden_values_then_beliefs_the_stage_and_checks(site: Site) -> None:
    kinds = [lane.kind for lane in timeline_of(site).lanes]

    assert kinds == sorted(kinds, key=["hidden", "belief", "stage", "check"].index)
    assert {"hidden", "stage", "check"} <= set(kinds)


def test_spans_of_a_lane_follow_each_other_to_the_end(site: Site) -> None:
    timeline = timeline_of(site)

    for lane in timeline.lanes:
        ends = [lane.spans[0].begin, *(span.end for span in lane.spans)]
        assert [span.begin for span in lane.spans] == ends[:-1]
        assert (ends[0], ends[-1]) == (0.0, timeline.end)


def test_the_drawing_is_well_formed_and_places_are_percentages(site: Site) -> None:
    drawn = ElementTree.fromstring(timeline_of(site).svg())

    spans = [child for child in drawn if (child.get("class") or "").startswith("span")]
    assert spans
    assert all(re.fullmatch(r"\d+\.\d+%", span.get("x") or "") for span in spans)
    assert "style" not in {name for child in drawn.iter() for name in child.attrib}


def test_events_and_new_violations_are_marked(site: Site) -> None:
    event = Event(time=4.2, name="press", total=3)
    marks = timeline_of(site, events=[event]).marks

    assert [(mark.kind, mark.time) for mark in marks] == [("event", 4.2), ("violation", 4.5)]


def test_a_violation_is_told_once(site: Site) -> None:
    from server import episodes

    [id, *_] = site.episodes(site.completed, failure=Failure.OVERCOUNT)
    with site.hub.database.reading() as session:
        episode, decisions = episodes.get(session, id), episodes.decisions(session, id)
    again = [one.model_copy(update={"violations": [Failure.OVERCOUNT]}) for one in decisions]

    rows = rows_of(episode, again)

    assert [row.violations for row in rows] == [[Failure.OVERCOUNT], [], []]
    assert [row.chosen for row in rows] == [0.0, 1.5, 3.0]
    assert [row.changed for row in rows] == [{"presses_done": n} for n in (1, 2, 3)]


def test_an_episode_without_decisions_can_be_drawn(site: Site) -> None:
    from server import episodes

    [id, *_] = site.episodes(site.completed)
    with site.hub.database.reading() as session:
        episode = episodes.get(session, id)
    none: list[DecisionPublic] = []
    spans: list[SpanPublic] = []

    assert Timeline(episode, none, spans).svg()


def test_text_in_a_drawing_is_escaped() -> None:
    drawn = element("text", "<b>", class_='"', x=1.5)

    assert drawn == '<text class="&#34;" x="1.5">&lt;b&gt;</text>'


def test_bars_stay_within_their_track(site: Site) -> None:
    from server import evaluations

    with site.hub.database.reading() as session:
        found = [evaluations.get(session, id) for id in (site.queued, site.completed, site.running)]

    for one in found:
        text = progress_bar(one.progress, one.verdicts) + rate_bar(one.verdicts.success, 1.0)
        assert all(0 <= float(share) <= 100 for share in re.findall(r"\"([\d.]+)%\"", text))
