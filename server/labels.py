"""What people say of episodes: labels and notes. They are only added, and change no verdict.

A label is taken back by another row that withdraws it, so it stays known who said what.
"""

from collections.abc import Sequence

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session, aliased

from server.access import Principal
from server.models import Episode, EpisodeLabel, new_id
from server.problems import Problem, invalid, not_found
from server.schemas.episodes import LabelCount, LabelCreate, LabelPublic
from server.states import EpisodeState

MOST = 200  # of an episode, withdrawn ones as well


def add(
    session: Session, episode: Episode, wanted: LabelCreate, principal: Principal
) -> LabelPublic:
    """Says something of an episode.

    Raises:
        Problem: 422, it says nothing; 409, the episode is not final, or has too many labels.
    """
    if wanted.label is None and not wanted.note.strip():
        raise invalid("note", "is empty; give a label, a note, or both")
    if episode.state != EpisodeState.FINAL:
        raise Problem(409, "not_final", f"Episode {episode.id} is {episode.state}; wait for it.")
    _require_room(session, episode)
    row = EpisodeLabel(
        id=new_id("la"),
        episode_id=episode.id,
        label=wanted.label,
        note=wanted.note,
        author_id=principal.user,
    )
    session.add(row)
    session.flush()
    session.refresh(row)
    return _public(row, None)


def _require_room(session: Session, episode: Episode) -> None:
    there = select(func.count()).where(EpisodeLabel.episode_id == episode.id)
    if (session.scalar(there) or 0) >= MOST:
        raise Problem(409, "too_many", f"Episode {episode.id} has {MOST} labels; no more are kept.")


def withdraw(session: Session, id: str, principal: Principal) -> LabelPublic:
    """Takes a label of one's own back; a maintainer may take back anybody's. Twice is fine.

    Raises:
        Problem: 404, there is none; 403, it is somebody else's.
    """
    row = session.get(EpisodeLabel, id)
    if row is None or row.withdraws is not None:
        raise not_found("label", id)
    principal.require_own(row.author_id, f"Label {row.id}")
    withdrawal = session.scalar(select(EpisodeLabel).where(EpisodeLabel.withdraws == id))
    if withdrawal is None:
        withdrawal = EpisodeLabel(
            id=new_id("la"),
            episode_id=row.episode_id,
            withdraws=row.id,
            author_id=principal.user,
        )
        session.add(withdrawal)
        session.flush()
        session.refresh(withdrawal)
    return _public(row, withdrawal)


def of_episode(session: Session, episode: str) -> list[LabelPublic]:
    """What was said of an episode, in order, what was taken back as well."""
    return of_episodes(session, [episode])[episode]


def of_episodes(session: Session, episodes: Sequence[str]) -> dict[str, list[LabelPublic]]:
    """What was said of each episode, in order, what was taken back as well."""
    found = select(EpisodeLabel).where(EpisodeLabel.episode_id.in_(episodes))
    rows: Sequence[EpisodeLabel] = session.scalars(found.order_by(EpisodeLabel.id)).all()
    withdrawals = {row.withdraws: row for row in rows if row.withdraws}
    said: dict[str, list[LabelPublic]] = {id: [] for id in episodes}
    for row in rows:
        if not row.withdraws:
            said[row.episode_id].append(_public(row, withdrawals.get(row.id)))
    return said


def counted(session: Session, *episodes: ColumnElement[bool]) -> list[LabelCount]:
    """The labels that stand, on all episodes or some, the most frequent first."""
    number = func.count(EpisodeLabel.episode_id.distinct())
    counts = select(EpisodeLabel.label, number)
    if episodes:
        counts = counts.join(Episode, Episode.id == EpisodeLabel.episode_id).where(*episodes)
    found = session.execute(
        counts.where(EpisodeLabel.label.is_not(None), _stands())
        .group_by(EpisodeLabel.label)
        .order_by(number.desc(), EpisodeLabel.label)
    )
    return [LabelCount(label=str(label), episodes=episodes) for label, episodes in found]


def has(any_of: Sequence[str]) -> ColumnElement[bool]:
    """True for episodes on which one of these labels stands."""
    stands = EpisodeLabel.label.in_(any_of) & _stands()
    return Episode.id.in_(select(EpisodeLabel.episode_id).where(stands))


def any_stands() -> ColumnElement[bool]:
    """True for episodes on which a label or a note stands."""
    stands = EpisodeLabel.withdraws.is_(None) & _stands()
    return Episode.id.in_(select(EpisodeLabel.episode_id).where(stands))


def noted(word: str) -> ColumnElement[bool]:
    """True for episodes with a word in a note that stands."""
    says = EpisodeLabel.note.icontains(word, autoescape=True) & _stands()
    return Episode.id.in_(select(EpisodeLabel.episode_id).where(says))


def _stands() -> ColumnElement[bool]:
    other = aliased(EpisodeLabel)
    withdrawn = select(other.id).where(other.withdraws == EpisodeLabel.id)
    return ~withdrawn.correlate(EpisodeLabel).exists()


def _public(row: EpisodeLabel, withdrawal: EpisodeLabel | None) -> LabelPublic:
    return LabelPublic(
        id=row.id,
        episode=row.episode_id,
        label=row.label,
        note=row.note,
        author=row.author.name,
        created=row.created,
        withdrawn=withdrawal and withdrawal.created,
        withdrawn_by=withdrawal and withdrawal.author.name,
    )
