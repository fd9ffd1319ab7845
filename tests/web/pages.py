"""The pages of a filled site: every test of pages opens all that stand here."""

from server.states import EpisodeState
from tests.web.sites import Site


def pages(site: Site) -> dict[str, str]:
    """The address of every page but those with the viewer, by a name for its picture."""
    [pending, *_] = site.episodes(site.running, state=EpisodeState.PENDING)
    return {
        "leaderboard": "/",
        "leaderboard-exact": "/?split=val&verdict=exact",
        "leaderboard-categories": "/?view=bars",
        "leaderboard-radar": "/?view=radar",
        "leaderboard-tasks": "/?view=tasks",
        "evaluations": "/evaluations",
        "evaluation-new": "/evaluations/new",
        "evaluation-new-upload": "/evaluations/new?source=upload",
        "evaluation-new-server": "/evaluations/new?source=server",
        "evaluation-rerun": f"/evaluations/new?like={site.completed}",
        "demo": "/demo",
        "tasks": "/tasks",
        "task": "/tasks/push_button_times",
        "task-weak": "/tasks/stack_blocks",
        "evaluation-completed": f"/evaluations/{site.completed}",
        "evaluation-running": f"/evaluations/{site.running}",
        "evaluation-incomplete": f"/evaluations/{site.incomplete}",
        "failures": "/failures",
        "failures-of-a-task": "/failures?task=search_drawer",
        "failures-none": "/failures?text=zebra&task=search_drawer",
        "failures-of-one": f"/evaluations/{site.completed}/failures?task=search_drawer",
        "episode-pending": f"/episodes/{pending}",
        "policy": f"/policies/{site.checkpoint}",
        "batches": "/batches",
        "batch": f"/batches/{site.batch}",
        "comparison": "/comparisons?a=mine&b=expert",
        "comparison-empty": "/comparisons",
        "ablations": "/ablations",
        "snapshots": "/snapshots",
        "snapshot": "/snapshots/1",
        "account": "/account",
        "webhooks": "/account/webhooks",
        "webhook": f"/account/webhooks/{site.webhook}",
    }


def paths(site: Site) -> list[str]:
    """The addresses alone."""
    return list(pages(site).values())
