"""The pages of a filled site, by address: every test of pages opens all that stand here."""

from server.states import EpisodeState
from tests.web.sites import Site


def paths(site: Site) -> list[str]:
    """Every page but those with the viewer."""
    [pending, *_] = site.episodes(site.running, state=EpisodeState.PENDING)
    return [
        "/",
        "/?split=val&verdict=exact",
        "/evaluations",
        "/evaluations/new",
        "/tasks",
        "/tasks/push_button_times",
        *(f"/evaluations/{id}" for id in (site.completed, site.running, site.incomplete)),
        f"/evaluations/{site.completed}/failures?task=search_drawer",
        f"/episodes/{pending}",
        f"/policies/{site.checkpoint}",
        "/batches",
        f"/batches/{site.batch}",
        "/comparisons?a=mine&b=expert",
        "/snapshots",
        "/snapshots/1",
        "/account",
        "/account/webhooks",
        f"/account/webhooks/{site.webhook}",
    ]
