"""Labels and notes on episodes."""

from fastapi import Response

from server import episodes, labels
from server.access import Router, Scope, needs
from server.deps import Reading, TheHub, ThePrincipal
from server.schemas.episodes import LabelCount, LabelCreate, LabelPublic

router = Router(tags=["episodes"])


@router.get("/labels")
@needs(Scope.READ)
def count_labels(session: Reading) -> list[LabelCount]:
    """The labels in use, the most frequent first."""
    return labels.counted(session)


@router.get("/episodes/{episode}/labels")
@needs(Scope.READ)
def list_labels(episode: str, session: Reading) -> list[LabelPublic]:
    """What was said of an episode, in order; what was taken back says so."""
    return labels.of_episode(session, episodes.row(session, episode).id)


@router.post("/episodes/{episode}/labels", status_code=201)
@needs(Scope.SUBMIT)
def add_label(
    episode: str, wanted: LabelCreate, hub: TheHub, principal: ThePrincipal, response: Response
) -> LabelPublic:
    """Puts a label or a note on a final episode; it changes no verdict."""
    with hub.database.writing() as session:
        added = labels.add(session, episodes.row(session, episode), wanted, principal)
    response.headers["Location"] = f"/api/v1/episodes/{episode}/labels"
    return added


@router.post("/labels/{label}/withdrawal")
@needs(Scope.SUBMIT)
def withdraw_label(label: str, hub: TheHub, principal: ThePrincipal) -> LabelPublic:
    """Takes a label of one's own back; it stays known that it was there."""
    with hub.database.writing() as session:
        return labels.withdraw(session, label, principal)
