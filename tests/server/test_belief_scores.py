"""How often a policy's stated number of stages is right, over an evaluation."""

import pytest

from server import belief_scores, beliefs
from server.belief_scores import Heard, heard, public, told
from tests.web.sites import Site


def test_an_evaluations_score_is_that_of_its_episodes(site: Site) -> None:
    [episode] = site.episodes(site.recorded)
    with site.hub.database.reading() as session:
        one = beliefs.of(session, episode)
        found = heard(session, site.recorded)

    assert one.checked > one.right > 0
    assert (found.episodes, found.decisions, found.right) == (1, one.checked, one.right)


def test_who_says_nothing_has_no_score(site: Site) -> None:
    with site.hub.database.reading() as session:
        assert told(session, [site.completed]) == {site.completed: None}
    assert public(Heard()) is None


def test_what_was_counted_once_is_not_read_again(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    with site.hub.database.reading() as session:
        first = told(session, [site.recorded])
        monkeypatch.setattr(belief_scores, "heard", None)
        assert told(session, [site.recorded]) == first


def test_an_interval_is_wider_where_whole_episodes_are_right_or_wrong() -> None:
    alike, apart = Heard(), Heard()
    for number in range(40):
        alike = alike.and_episode(right=4 + 2 * (number % 2), decisions=10)
        apart = apart.and_episode(right=10 * (number % 2), decisions=10)

    narrow, wide = public(alike), public(apart)

    assert narrow is not None and wide is not None
    assert narrow.value == wide.value == 0.5
    assert wide.high - wide.low > 1.1 * (narrow.high - narrow.low)
