"""The ledger: its tables, and triggers that hold what must never be broken.

A state moves only as `server/states.py` says (a test compares), a final episode and its decisions
never change, and events, versions and alarms are only ever added. A later migration that alters a
table in batch mode copies it, and must create its triggers anew.
"""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

MOVES: dict[str, dict[str, tuple[str, ...]]] = {
    "evaluations": {
        "queued": ("running", "completed", "incomplete", "cancelled"),
        "running": ("completed", "incomplete", "cancelled"),
        "incomplete": ("queued", "cancelled"),
    },
    "shards": {
        "pending": ("leased", "failed", "cancelled"),
        "leased": ("pending", "done", "failed", "cancelled"),
        "failed": ("pending", "cancelled"),
    },
    "attempts": {"open": ("done", "lost", "cancelled")},
    "episodes": {"pending": ("running", "final"), "running": ("pending", "final")},
}
FINAL_EPISODE = "(SELECT state FROM episodes WHERE id = NEW.episode_id) = 'final'"
TABLES = (
    "blobs",
    "policies",
    "policy_versions",
    "evaluations",
    "events",
    "shards",
    "attempts",
    "episodes",
    "decisions",
    "divergences",
    "hidden_changes",
    "hidden_spans",
)
FORBIDDEN = (  # table, what, when, the message
    ("episodes", "UPDATE", "OLD.state = 'final'", "a final episode is immutable"),
    ("episodes", "DELETE", "OLD.state = 'final'", "a final episode is immutable"),
    ("decisions", "INSERT", FINAL_EPISODE, "a final episode is immutable"),
    ("decisions", "UPDATE", "TRUE", "decisions are immutable"),
    ("decisions", "DELETE", "TRUE", "decisions are immutable"),
    ("hidden_changes", "INSERT", FINAL_EPISODE, "a final episode is immutable"),
    ("hidden_changes", "UPDATE", "TRUE", "hidden states are immutable"),
    ("hidden_changes", "DELETE", "TRUE", "hidden states are immutable"),
    ("attempts", "UPDATE", "OLD.state <> 'open'", "an ended attempt is immutable"),
    ("policy_versions", "UPDATE", "TRUE", "a policy version is immutable"),
    ("policy_versions", "DELETE", "TRUE", "a policy version is immutable"),
    ("events", "UPDATE", "TRUE", "events are immutable"),
    ("events", "DELETE", "TRUE", "events are immutable"),
    ("divergences", "UPDATE", "TRUE", "alarms are immutable"),
    ("divergences", "DELETE", "TRUE", "alarms are immutable"),
    ("blobs", "UPDATE", "TRUE", "blobs are immutable"),
    ("blobs", "DELETE", "TRUE", "blobs are immutable"),
    ("attempts", "DELETE", "OLD.state <> 'open'", "an ended attempt is immutable"),
)


def forbid(name: str, table: str, what: str, when: str, message: str) -> None:
    """Creates a trigger that aborts a statement."""
    op.execute(
        f"CREATE TRIGGER {name} BEFORE {what} ON {table} FOR EACH ROW WHEN {when} "
        f"BEGIN SELECT RAISE(ABORT, '{message}'); END"
    )


def guard_states() -> None:
    """Creates the triggers of the states: how a row begins, and how it may go on."""
    for table, moves in MOVES.items():
        first = next(iter(moves))
        begins = f"{table} begin as {first}"
        forbid(f"{table}_begin", table, "INSERT", f"NEW.state <> '{first}'", begins)
        allowed = " OR ".join(
            f"(OLD.state = '{old}' AND NEW.state IN ({', '.join(map(repr, new))}))"
            if len(new) > 1
            else f"(OLD.state = '{old}' AND NEW.state = '{new[0]}')"
            for old, new in moves.items()
        )
        illegal = f"OLD.state <> NEW.state AND NOT ({allowed})"
        forbid(f"{table}_move", table, "UPDATE OF state", illegal, f"{table} do not move so")


def upgrade() -> None:
    op.create_table(
        "blobs",
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("size", sa.Integer(), nullable=False),
        sa.Column("media_type", sa.String(length=80), nullable=False),
        sa.Column("created", sa.DateTime(), nullable=False),
        sa.PrimaryKeyConstraint("sha256"),
    )
    op.create_table(
        "policies",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("name", sa.String(length=80), nullable=False),
        sa.Column("created", sa.DateTime(), nullable=False),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("name"),
    )
    op.create_table(
        "policy_versions",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("policy_id", sa.String(length=32), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("description", sa.String(), nullable=False),
        sa.Column("spec", sa.JSON(), nullable=False),
        sa.Column("reference", sa.Boolean(), nullable=False),
        sa.Column("created", sa.DateTime(), nullable=False),
        sa.ForeignKeyConstraint(
            ["policy_id"],
            ["policies.id"],
        ),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("policy_id", "number"),
    )
    op.create_table(
        "evaluations",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("policy_version_id", sa.String(length=32), nullable=False),
        sa.Column("suite", sa.String(length=80), nullable=False),
        sa.Column("suite_version", sa.Integer(), nullable=False),
        sa.Column("split", sa.String(length=80), nullable=False),
        sa.Column("rules", sa.String(length=80), nullable=False),
        sa.Column("tasks", sa.JSON(), nullable=False),
        sa.Column("episodes", sa.Integer(), nullable=False),
        sa.Column("sources", sa.JSON(), nullable=False),
        sa.Column("machine", sa.JSON(), nullable=False),
        sa.Column("priority", sa.Integer(), nullable=False),
        sa.Column("recordings", sa.Boolean(), nullable=False),
        sa.Column("state", sa.String(length=80), nullable=False),
        sa.Column("desired", sa.String(length=80), nullable=False),
        sa.Column("reason", sa.String(), nullable=True),
        sa.Column("created", sa.DateTime(), nullable=False),
        sa.Column("started", sa.DateTime(), nullable=True),
        sa.Column("ended", sa.DateTime(), nullable=True),
        sa.Column("idempotency_key", sa.String(length=200), nullable=True),
        sa.Column("request_digest", sa.String(length=64), nullable=True),
        sa.ForeignKeyConstraint(
            ["policy_version_id"],
            ["policy_versions.id"],
        ),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("idempotency_key"),
    )
    op.create_index("evaluations_by_state", "evaluations", ["state", "id"], unique=False)
    op.create_index(
        "ix_evaluations_policy_version_id", "evaluations", ["policy_version_id"], unique=False
    )

    op.create_table(
        "events",
        sa.Column("seq", sa.Integer(), nullable=False),
        sa.Column("time", sa.DateTime(), nullable=False),
        sa.Column("evaluation_id", sa.String(length=32), nullable=False),
        sa.Column("kind", sa.String(length=80), nullable=False),
        sa.Column("payload", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(
            ["evaluation_id"],
            ["evaluations.id"],
        ),
        sa.PrimaryKeyConstraint("seq"),
        sqlite_autoincrement=True,
    )
    op.create_index("events_by_evaluation", "events", ["evaluation_id", "seq"], unique=False)

    op.create_table(
        "shards",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("evaluation_id", sa.String(length=32), nullable=False),
        sa.Column("task", sa.String(length=80), nullable=False),
        sa.Column("first_index", sa.Integer(), nullable=False),
        sa.Column("state", sa.String(length=80), nullable=False),
        sa.Column("fence", sa.Integer(), nullable=False),
        sa.Column("faults", sa.Integer(), nullable=False),
        sa.Column("reason", sa.String(), nullable=True),
        sa.ForeignKeyConstraint(
            ["evaluation_id"],
            ["evaluations.id"],
        ),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("evaluation_id", "task", "first_index"),
    )
    op.create_index("shards_by_state", "shards", ["state", "evaluation_id"], unique=False)

    op.create_table(
        "attempts",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("shard_id", sa.String(length=32), nullable=False),
        sa.Column("fence", sa.Integer(), nullable=False),
        sa.Column("engine", sa.String(length=80), nullable=False),
        sa.Column("state", sa.String(length=80), nullable=False),
        sa.Column("token_hash", sa.String(length=64), nullable=False),
        sa.Column("leased", sa.DateTime(), nullable=False),
        sa.Column("ended", sa.DateTime(), nullable=True),
        sa.Column("reason", sa.String(), nullable=True),
        sa.ForeignKeyConstraint(
            ["shard_id"],
            ["shards.id"],
        ),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("shard_id", "fence"),
    )
    op.create_index("attempts_by_state", "attempts", ["state"], unique=False)
    op.create_index(
        "one_open_attempt",
        "attempts",
        ["shard_id"],
        unique=True,
        sqlite_where=sa.text("state = 'open'"),
        postgresql_where=sa.text("state = 'open'"),
    )

    op.create_table(
        "episodes",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("evaluation_id", sa.String(length=32), nullable=False),
        sa.Column("shard_id", sa.String(length=32), nullable=False),
        sa.Column("task", sa.String(length=80), nullable=False),
        sa.Column("category", sa.String(length=80), nullable=False),
        sa.Column("split", sa.String(length=80), nullable=False),
        sa.Column("index", sa.Integer(), nullable=False),
        sa.Column("variation", sa.JSON(), nullable=False),
        sa.Column("draw", sa.Integer(), nullable=False),
        sa.Column("state", sa.String(length=80), nullable=False),
        sa.Column("fence", sa.Integer(), nullable=False),
        sa.Column("started", sa.DateTime(), nullable=True),
        sa.Column("success", sa.Boolean(), nullable=True),
        sa.Column("exact", sa.Boolean(), nullable=True),
        sa.Column("failure", sa.String(length=80), nullable=True),
        sa.Column("detail", sa.String(), nullable=False),
        sa.Column("instruction", sa.String(), nullable=True),
        sa.Column("decisions", sa.Integer(), nullable=True),
        sa.Column("stage", sa.String(), nullable=True),
        sa.Column("scene_hash", sa.String(length=64), nullable=True),
        sa.Column("final_state_hash", sa.String(length=64), nullable=True),
        sa.Column("start", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("timing", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("digest", sa.String(length=64), nullable=True),
        sa.Column("recording", sa.String(length=64), nullable=True),
        sa.Column("thumbnail", sa.String(length=64), nullable=True),
        sa.Column("committed", sa.DateTime(), nullable=True),
        sa.CheckConstraint(
            "(state = 'final') = (digest IS NOT NULL AND success IS NOT NULL "
            "AND exact IS NOT NULL AND committed IS NOT NULL)",
            name="final_is_whole",
        ),
        sa.CheckConstraint(
            "exact IS NULL OR exact = (failure IS NULL)", name="exact_has_no_failure"
        ),
        sa.ForeignKeyConstraint(
            ["evaluation_id"],
            ["evaluations.id"],
        ),
        sa.ForeignKeyConstraint(
            ["recording"],
            ["blobs.sha256"],
        ),
        sa.ForeignKeyConstraint(
            ["shard_id"],
            ["shards.id"],
        ),
        sa.ForeignKeyConstraint(
            ["thumbnail"],
            ["blobs.sha256"],
        ),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("evaluation_id", "task", "index"),
    )
    op.create_index(
        "episodes_by_failure", "episodes", ["evaluation_id", "failure", "category"], unique=False
    )
    op.create_index("episodes_by_shard", "episodes", ["shard_id"], unique=False)

    op.create_table(
        "decisions",
        sa.Column("episode_id", sa.String(length=32), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("time", sa.Double(), nullable=False),
        sa.Column("action", sa.JSON(), nullable=False),
        sa.Column("outcome", sa.String(length=80), nullable=False),
        sa.Column("retried", sa.Boolean(), nullable=False),
        sa.Column("path", sa.String(length=80), nullable=False),
        sa.Column("stage", sa.String(), nullable=False),
        sa.Column("hidden", sa.JSON(), nullable=False),
        sa.Column("checks", sa.JSON(), nullable=False),
        sa.Column("success", sa.Boolean(), nullable=False),
        sa.Column("events", sa.JSON(), nullable=False),
        sa.Column("violations", sa.JSON(), nullable=False),
        sa.Column("belief", sa.JSON(none_as_null=True), nullable=True),
        sa.ForeignKeyConstraint(
            ["episode_id"],
            ["episodes.id"],
        ),
        sa.PrimaryKeyConstraint("episode_id", "number"),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "divergences",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("episode_id", sa.String(length=32), nullable=False),
        sa.Column("attempt_id", sa.String(length=32), nullable=False),
        sa.Column("kept", sa.String(length=64), nullable=False),
        sa.Column("other", sa.String(length=64), nullable=False),
        sa.Column("result", sa.JSON(), nullable=False),
        sa.Column("created", sa.DateTime(), nullable=False),
        sa.ForeignKeyConstraint(
            ["attempt_id"],
            ["attempts.id"],
        ),
        sa.ForeignKeyConstraint(
            ["episode_id"],
            ["episodes.id"],
        ),
        sa.PrimaryKeyConstraint("id"),
    )
    op.create_index("ix_divergences_episode_id", "divergences", ["episode_id"], unique=False)

    op.create_table(
        "hidden_changes",
        sa.Column("episode_id", sa.String(length=32), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("time", sa.Double(), nullable=False),
        sa.Column("decision", sa.Integer(), nullable=False),
        sa.Column("stage", sa.String(), nullable=False),
        sa.Column("hidden", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(
            ["episode_id"],
            ["episodes.id"],
        ),
        sa.PrimaryKeyConstraint("episode_id", "number"),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "hidden_spans",
        sa.Column("episode_id", sa.String(length=32), nullable=False),
        sa.Column("kind", sa.String(length=80), nullable=False),
        sa.Column("name", sa.String(length=80), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("value", sa.JSON(), nullable=False),
        sa.Column("decision_from", sa.Integer(), nullable=False),
        sa.Column("decision_to", sa.Integer(), nullable=False),
        sa.Column("time_from", sa.Double(), nullable=False),
        sa.Column("time_to", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(
            ["episode_id"],
            ["episodes.id"],
        ),
        sa.PrimaryKeyConstraint("episode_id", "kind", "name", "number"),
        sqlite_with_rowid=False,
    )
    op.create_index("hidden_spans_by_name", "hidden_spans", ["kind", "name"], unique=False)
    guard_states()
    for number, (table, what, when, message) in enumerate(FORBIDDEN):
        forbid(f"{table}_{what.lower()}_{number}", table, what, when, message)


def downgrade() -> None:
    for table in TABLES[::-1]:  # indexes and triggers go with them
        op.drop_table(table)
