"""Of one episode: what its policy believed, its actions, and how to play it again."""

from fastapi import Response

from server import beliefs, episodes, reruns
from server.access import Router, Scope, needs
from server.deps import Reading
from server.schemas.episodes import BeliefsPublic, RerunPublic
from workers.actions_file import EpisodeActions

router = Router(prefix="/episodes/{episode}", tags=["episodes"])


@router.get("/beliefs")
@needs(Scope.READ)
def get_beliefs(episode: str, session: Reading) -> BeliefsPublic:
    """How many stages its policy held to be done at each decision, and how many were."""
    return beliefs.of(session, episode)


@router.get("/actions.json")
@needs(Scope.READ)
def get_actions(episode: str, session: Reading, response: Response) -> EpisodeActions:
    """Its actions as a file, which `hide eval replay:FILE.json` plays again."""
    name = reruns.actions_file(episodes.get(session, episode))
    response.headers["Content-Disposition"] = f'attachment; filename="{name}"'
    return reruns.actions_of(session, episode)


@router.get("/rerun")
@needs(Scope.READ)
def get_rerun(episode: str, session: Reading) -> RerunPublic:
    """The command that plays it on another machine, and the hashes that must come of it."""
    return reruns.rerun(session, episode)
