"""The tables of the ledger. It is the only truth: what an engine or a worker says is checked
against it, and what it holds of a final episode never changes.
"""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any, ClassVar

from sqlalchemy import (
    JSON,
    BigInteger,
    CheckConstraint,
    DateTime,
    Dialect,
    ForeignKey,
    Index,
    Integer,
    String,
    TypeDecorator,
    UniqueConstraint,
    text,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship
from ulid import ULIDGenerator

Id = String(32)
Digest = String(64)
Name = String(80)


class Utc(TypeDecorator[datetime]):
    """A moment in UTC; databases without time zones keep it without one."""

    impl = DateTime
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _: Dialect) -> datetime | None:
        return value.astimezone(UTC).replace(tzinfo=None) if value else None

    def process_result_value(self, value: datetime | None, _: Dialect) -> datetime | None:
        return value.replace(tzinfo=UTC) if value else None


def read_clock() -> datetime:
    """What the machine's clock says. It may be wrong, and jump: nothing but dates hangs on it."""
    return datetime.now(UTC)


clock: Callable[[], datetime] = read_clock


def now() -> datetime:
    """This moment, in UTC."""
    return clock()


def _milliseconds() -> int:
    """As `now`, but never back: what is newer has the higher identifier while a server runs."""
    global _latest
    _latest = max(_latest, int(now().timestamp() * 1000))
    return _latest


_latest = 0
_ids = ULIDGenerator(clock=_milliseconds)


def new_id(prefix: str) -> str:
    """A new identifier that sorts by time, e.g. 'ev_01J…'."""
    return f"{prefix}_{_ids.generate()}"


class Base(DeclarativeBase):
    type_annotation_map: ClassVar[Any] = {
        datetime: Utc,
        dict[str, Any]: JSON,
        list[Any]: JSON,
        Any: JSON,
    }


class User(Base):
    """Somebody who may use the server. Local mode knows one, its owner, who has no password."""

    __tablename__ = "users"
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(Name, unique=True)
    role: Mapped[str] = mapped_column(Name)
    password_hash: Mapped[str | None] = mapped_column(String(200))  # argon2id
    active: Mapped[bool] = mapped_column(default=True)
    attempts: Mapped[int | None]  # quotas; null: as the server's settings say
    scored: Mapped[int | None]
    storage: Mapped[int | None] = mapped_column(BigInteger)  # bytes
    created: Mapped[datetime] = mapped_column(default=now)


class SignIn(Base):
    """A browser in which a user is signed in; the ledger does not know its cookie."""

    __tablename__ = "sign_ins"
    secret_hash: Mapped[str] = mapped_column(Digest, primary_key=True)
    user_id: Mapped[str] = mapped_column(ForeignKey("users.id"), index=True)
    created: Mapped[datetime] = mapped_column(default=now)
    expires: Mapped[datetime]
    user: Mapped[User] = relationship(lazy="joined")


class Token(Base):
    """What a program shows instead of a password: `hide_<id>_<secret>`."""

    __tablename__ = "tokens"
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    user_id: Mapped[str] = mapped_column(ForeignKey("users.id"), index=True)
    name: Mapped[str] = mapped_column(Name)
    secret_hash: Mapped[str] = mapped_column(Digest)
    scopes: Mapped[list[Any]]
    created: Mapped[datetime] = mapped_column(default=now)
    expires: Mapped[datetime | None]
    last_used: Mapped[datetime | None]  # to within some minutes
    revoked: Mapped[datetime | None]
    user: Mapped[User] = relationship(lazy="joined")


class Upload(Base):
    """A checkpoint on its way in; how much has come is the size of its file."""

    __tablename__ = "uploads"
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner_id: Mapped[str] = mapped_column(ForeignKey("users.id"), index=True)
    length: Mapped[int] = mapped_column(BigInteger)  # bytes it will have
    name: Mapped[str] = mapped_column(Name)  # of the policy
    description: Mapped[str] = mapped_column(default="")
    sha256: Mapped[str | None] = mapped_column(Digest)  # that the client says it has
    created: Mapped[datetime] = mapped_column(default=now)
    expires: Mapped[datetime]


class AuditEntry(Base):
    """Something that somebody changed or was refused; only ever added."""

    __tablename__ = "audit_entries"
    __table_args__ = ({"sqlite_autoincrement": True},)
    seq: Mapped[int] = mapped_column(primary_key=True)
    time: Mapped[datetime] = mapped_column(default=now)
    user_id: Mapped[str | None] = mapped_column(ForeignKey("users.id"), index=True)
    name: Mapped[str] = mapped_column(Name)  # of the user then, or that a sign-in gave
    via: Mapped[str] = mapped_column(Name)  # local, session, token id, or command
    address: Mapped[str] = mapped_column(Name)  # of the client
    action: Mapped[str] = mapped_column(Name)  # of the route or command
    subject: Mapped[str] = mapped_column(String(300))
    status: Mapped[int]  # as HTTP; a command's is 200


class Policy(Base):
    """A policy by name."""

    __tablename__ = "policies"
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(Name, unique=True)
    created: Mapped[datetime] = mapped_column(default=now)
    owner_id: Mapped[str | None] = mapped_column(ForeignKey("users.id"))  # null: the server's own
    owner: Mapped[User | None] = relationship(lazy="joined")
    versions: Mapped[list["PolicyVersion"]] = relationship(back_populates="policy")


class PolicyVersion(Base):
    """What is played under a policy's name; it never changes."""

    __tablename__ = "policy_versions"
    __table_args__ = (UniqueConstraint("policy_id", "number"),)
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    policy_id: Mapped[str] = mapped_column(ForeignKey("policies.id"))
    number: Mapped[int]
    description: Mapped[str] = mapped_column(default="")
    spec: Mapped[dict[str, Any]]
    reference: Mapped[bool] = mapped_column(default=False)
    checks: Mapped[list[Any] | None]  # what was tried of it when it came
    # PolicyFacts, of a checkpoint's header or declared; null: as `server.facts` knows without them
    facts: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    created: Mapped[datetime] = mapped_column(default=now)
    policy: Mapped[Policy] = relationship(back_populates="versions", lazy="joined")


class Evaluation(Base):
    """A policy version that is played on a split of the suite."""

    __tablename__ = "evaluations"
    __table_args__ = (Index("evaluations_by_state", "state", "id"),)
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    policy_version_id: Mapped[str] = mapped_column(ForeignKey("policy_versions.id"), index=True)
    suite: Mapped[str] = mapped_column(Name)
    suite_version: Mapped[int]
    split: Mapped[str] = mapped_column(Name)
    rules: Mapped[str] = mapped_column(Name)
    tasks: Mapped[list[Any]]
    episodes: Mapped[int]  # per task
    sources: Mapped[dict[str, Any]]  # per task, the code that plays it
    machine: Mapped[dict[str, Any]]  # where it is played
    priority: Mapped[int] = mapped_column(default=0)
    recordings: Mapped[bool] = mapped_column(default=True)
    state: Mapped[str] = mapped_column(Name, default="queued")
    desired: Mapped[str] = mapped_column(Name, default="finished")
    reason: Mapped[str | None]
    created: Mapped[datetime] = mapped_column(default=now)
    started: Mapped[datetime | None]
    ended: Mapped[datetime | None]
    idempotency_key: Mapped[str | None] = mapped_column(String(200), unique=True)
    request_digest: Mapped[str | None] = mapped_column(Digest)
    owner_id: Mapped[str | None] = mapped_column(ForeignKey("users.id"), index=True)
    policy_version: Mapped[PolicyVersion] = relationship(lazy="joined")
    owner: Mapped[User | None] = relationship(lazy="joined")


class Shard(Base):
    """Up to five episodes of one task of an evaluation; what is handed out as a whole."""

    __tablename__ = "shards"
    __table_args__ = (
        UniqueConstraint("evaluation_id", "task", "first_index"),
        Index("shards_by_state", "state", "evaluation_id"),
    )
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    evaluation_id: Mapped[str] = mapped_column(ForeignKey("evaluations.id"))
    task: Mapped[str] = mapped_column(Name)
    first_index: Mapped[int]
    state: Mapped[str] = mapped_column(Name, default="pending")
    fence: Mapped[int] = mapped_column(default=0)  # the number of its newest attempt
    faults: Mapped[int] = mapped_column(default=0)  # attempts lost since it was last resumed
    reason: Mapped[str | None]  # why the last attempt was lost
    evaluation: Mapped[Evaluation] = relationship()
    episodes: Mapped[list["Episode"]] = relationship(
        back_populates="shard", order_by="Episode.index"
    )


class Attempt(Base):
    """One try at running a shard; while it is open, it alone may commit the shard's episodes."""

    __tablename__ = "attempts"
    __table_args__ = (
        UniqueConstraint("shard_id", "fence"),
        Index(
            "one_open_attempt",
            "shard_id",
            unique=True,
            sqlite_where=text("state = 'open'"),
            postgresql_where=text("state = 'open'"),
        ),
        Index("attempts_by_state", "state"),
    )
    id: Mapped[str] = mapped_column(Id, primary_key=True)  # also the engine's key
    shard_id: Mapped[str] = mapped_column(ForeignKey("shards.id"))
    fence: Mapped[int]
    engine: Mapped[str] = mapped_column(Name)
    state: Mapped[str] = mapped_column(Name, default="open")
    token_hash: Mapped[str] = mapped_column(Digest)
    leased: Mapped[datetime] = mapped_column(default=now)
    ended: Mapped[datetime | None]
    reason: Mapped[str | None]
    # that played it, once it told of an episode; what came before this column has the evaluation's
    machine: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    shard: Mapped[Shard] = relationship()


class Episode(Base):
    """One episode of an evaluation; final once it is committed."""

    __tablename__ = "episodes"
    __table_args__ = (
        UniqueConstraint("evaluation_id", "task", "index"),
        Index("episodes_by_failure", "evaluation_id", "failure", "category"),
        Index("episodes_by_shard", "shard_id"),
        CheckConstraint(
            "(state = 'final') = (digest IS NOT NULL AND success IS NOT NULL "
            "AND exact IS NOT NULL AND committed IS NOT NULL)",
            name="final_is_whole",
        ),
        CheckConstraint("exact IS NULL OR exact = (failure IS NULL)", name="exact_has_no_failure"),
    )
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    evaluation_id: Mapped[str] = mapped_column(ForeignKey("evaluations.id"))
    shard_id: Mapped[str] = mapped_column(ForeignKey("shards.id"))
    task: Mapped[str] = mapped_column(Name)
    category: Mapped[str] = mapped_column(Name)
    split: Mapped[str] = mapped_column(Name)
    index: Mapped[int]
    variation: Mapped[dict[str, Any]]
    draw: Mapped[int]
    state: Mapped[str] = mapped_column(Name, default="pending")
    fence: Mapped[int] = mapped_column(default=0)  # of the attempt that plays or committed it
    started: Mapped[datetime | None]
    # Known once it is final:
    success: Mapped[bool | None]
    exact: Mapped[bool | None]
    failure: Mapped[str | None] = mapped_column(Name)
    detail: Mapped[str] = mapped_column(default="")
    instruction: Mapped[str | None]
    decisions: Mapped[int | None]  # how many
    stage: Mapped[str | None]
    scene_hash: Mapped[str | None] = mapped_column(Digest)
    final_state_hash: Mapped[str | None] = mapped_column(Digest)
    start: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    timing: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))
    digest: Mapped[str | None] = mapped_column(Digest)
    recording: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    thumbnail: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    committed: Mapped[datetime | None]
    sandbox: Mapped[str | None] = mapped_column(Name)  # around the policy's process, if it had one
    shard: Mapped[Shard] = relationship(back_populates="episodes")
    evaluation: Mapped[Evaluation] = relationship(lazy="joined")
    removal: Mapped["Removal | None"] = relationship(  # of its recording
        primaryjoin="foreign(Episode.recording) == Removal.sha256", viewonly=True, lazy="joined"
    )


class Decision(Base):
    """One decision of an episode, with the hidden state after it: the truth."""

    __tablename__ = "decisions"
    __table_args__ = ({"sqlite_with_rowid": False},)
    episode_id: Mapped[str] = mapped_column(ForeignKey("episodes.id"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True)
    time: Mapped[float]  # simulated seconds at its end
    action: Mapped[dict[str, Any]]
    outcome: Mapped[str] = mapped_column(Name)
    retried: Mapped[bool]
    path: Mapped[str] = mapped_column(Name)
    stage: Mapped[str]
    hidden: Mapped[dict[str, Any]]
    checks: Mapped[dict[str, Any]]
    success: Mapped[bool]
    events: Mapped[list[Any]]
    violations: Mapped[list[Any]]
    belief: Mapped[dict[str, Any] | None] = mapped_column(JSON(none_as_null=True))


class HiddenChange(Base):
    """The hidden state from a moment on, seen at 20 Hz: a row for every change, also in a chunk."""

    __tablename__ = "hidden_changes"
    __table_args__ = ({"sqlite_with_rowid": False},)
    episode_id: Mapped[str] = mapped_column(ForeignKey("episodes.id"), primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True)
    time: Mapped[float]
    decision: Mapped[int]
    stage: Mapped[str]
    hidden: Mapped[dict[str, Any]]


class HiddenSpan(Base):
    """A value that held from one moment to another; derived from the two tables above."""

    __tablename__ = "hidden_spans"
    __table_args__ = (
        Index("hidden_spans_by_name", "kind", "name"),
        {"sqlite_with_rowid": False},
    )
    episode_id: Mapped[str] = mapped_column(ForeignKey("episodes.id"), primary_key=True)
    kind: Mapped[str] = mapped_column(Name, primary_key=True)  # hidden, stage, belief
    name: Mapped[str] = mapped_column(Name, primary_key=True)
    number: Mapped[int] = mapped_column(primary_key=True)
    value: Mapped[Any] = mapped_column(JSON)
    decision_from: Mapped[int]
    decision_to: Mapped[int]
    time_from: Mapped[float]
    time_to: Mapped[float]


class Event(Base):
    """Something that happened to an evaluation; the pages and clients follow it."""

    __tablename__ = "events"
    __table_args__ = (
        Index("events_by_evaluation", "evaluation_id", "seq"),
        {"sqlite_autoincrement": True},
    )
    seq: Mapped[int] = mapped_column(primary_key=True)
    time: Mapped[datetime] = mapped_column(default=now)
    evaluation_id: Mapped[str] = mapped_column(ForeignKey("evaluations.id"))
    kind: Mapped[str] = mapped_column(Name)
    payload: Mapped[dict[str, Any]]


class Blob(Base):
    """A file that is kept under its SHA-256."""

    __tablename__ = "blobs"
    sha256: Mapped[str] = mapped_column(Digest, primary_key=True)
    size: Mapped[int] = mapped_column(BigInteger().with_variant(Integer, "sqlite"))  # bytes
    media_type: Mapped[str] = mapped_column(Name)
    created: Mapped[datetime] = mapped_column(default=now)


class Removal(Base):
    """A file that is gone to make room; what was measured stays."""

    __tablename__ = "removals"
    sha256: Mapped[str] = mapped_column(ForeignKey("blobs.sha256"), primary_key=True)
    time: Mapped[datetime] = mapped_column(default=now)
    reason: Mapped[str] = mapped_column(Name)


class Divergence(Base):
    """A second, different result of a final episode: an alarm, never a score."""

    __tablename__ = "divergences"
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    episode_id: Mapped[str] = mapped_column(ForeignKey("episodes.id"), index=True)
    attempt_id: Mapped[str] = mapped_column(ForeignKey("attempts.id"))
    kept: Mapped[str] = mapped_column(Digest)
    other: Mapped[str] = mapped_column(Digest)
    result: Mapped[dict[str, Any]]
    created: Mapped[datetime] = mapped_column(default=now)


class Batch(Base):
    """Evaluations that were asked for together; its items are worked off in their order."""

    __tablename__ = "batches"
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    wanted: Mapped[list[Any]]  # as it was asked for, one an evaluation
    items: Mapped[list[Any]]  # what became of the first so many
    created: Mapped[datetime] = mapped_column(default=now)
    idempotency_key: Mapped[str | None] = mapped_column(Digest, unique=True)
    request_digest: Mapped[str] = mapped_column(Digest)
    owner_id: Mapped[str | None] = mapped_column(ForeignKey("users.id"), index=True)
    owner: Mapped[User | None] = relationship(lazy="joined")


class EpisodeLabel(Base):
    """What somebody says of an episode; only ever added, and never part of a score."""

    __tablename__ = "episode_labels"
    __table_args__ = (Index("episode_labels_by_label", "label", "episode_id"),)
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    episode_id: Mapped[str] = mapped_column(ForeignKey("episodes.id"), index=True)
    label: Mapped[str | None] = mapped_column(Name)
    note: Mapped[str] = mapped_column(default="")
    withdraws: Mapped[str | None] = mapped_column(ForeignKey("episode_labels.id"), unique=True)
    created: Mapped[datetime] = mapped_column(default=now)
    author_id: Mapped[str] = mapped_column(ForeignKey("users.id"))
    author: Mapped[User] = relationship(lazy="joined")


class LeaderboardSnapshot(Base):
    """A leaderboard as it stood; its content is kept to the byte and never changes."""

    __tablename__ = "leaderboard_snapshots"
    __table_args__ = ({"sqlite_autoincrement": True},)
    number: Mapped[int] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(Digest, unique=True)  # of the content in UTF-8
    content: Mapped[str]  # JSON
    suite: Mapped[str] = mapped_column(Name, server_default="hide")  # that of the earliest
    split: Mapped[str] = mapped_column(Name)
    note: Mapped[str] = mapped_column(default="")
    created: Mapped[datetime] = mapped_column(default=now)
    owner_id: Mapped[str | None] = mapped_column(ForeignKey("users.id"))
    owner: Mapped[User | None] = relationship(lazy="joined")


class Webhook(Base):
    """An address that is told what happens to evaluations."""

    __tablename__ = "webhooks"
    id: Mapped[str] = mapped_column(Id, primary_key=True)
    owner_id: Mapped[str] = mapped_column(ForeignKey("users.id"), index=True)
    url: Mapped[str] = mapped_column(String(500))
    description: Mapped[str] = mapped_column(default="")
    events: Mapped[list[Any]]
    everybodys: Mapped[bool] = mapped_column(default=False)  # else the owner's evaluations alone
    secret: Mapped[str] = mapped_column(Name)  # as it is: what signs must be known
    active: Mapped[bool] = mapped_column(default=True)
    reason: Mapped[str | None]  # why it is not active
    after: Mapped[int]  # the last event of which its deliveries are made
    created: Mapped[datetime] = mapped_column(default=now)


class Delivery(Base):
    """An event on its way to a webhook; its id stays the same over all tries."""

    __tablename__ = "deliveries"
    __table_args__ = (
        UniqueConstraint("webhook_id", "event_seq"),
        Index("deliveries_by_due", "state", "due"),
        {"sqlite_autoincrement": True},
    )
    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(Id, unique=True)
    webhook_id: Mapped[str] = mapped_column(ForeignKey("webhooks.id"))
    event_seq: Mapped[int | None] = mapped_column(ForeignKey("events.seq"))  # null: a trial
    kind: Mapped[str] = mapped_column(Name)
    body: Mapped[str]
    state: Mapped[str] = mapped_column(Name, default="pending")
    tries: Mapped[list[Any]]  # {time, status, error} of each
    due: Mapped[datetime | None] = mapped_column(default=now)  # null: it is not sent any more
    created: Mapped[datetime] = mapped_column(default=now)
    webhook: Mapped[Webhook] = relationship(lazy="joined")
