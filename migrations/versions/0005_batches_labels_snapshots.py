"""Batches that are kept, labels of episodes, snapshots of the leaderboard."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"

NEVER = (  # table, what, the message
    ("batches", "DELETE", "batches stay"),
    ("episode_labels", "UPDATE", "labels are immutable"),
    ("episode_labels", "DELETE", "labels are immutable"),
    ("leaderboard_snapshots", "UPDATE", "snapshots are immutable"),
    ("leaderboard_snapshots", "DELETE", "snapshots are immutable"),
)


def upgrade() -> None:
    op.create_table(
        "batches",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("wanted", sa.JSON(), nullable=False),
        sa.Column("items", sa.JSON(), nullable=False),
        sa.Column("created", sa.DateTime(), nullable=False),
        sa.Column("idempotency_key", sa.String(length=64), nullable=True),
        sa.Column("request_digest", sa.String(length=64), nullable=False),
        sa.Column("owner_id", sa.String(length=32), nullable=True),
        sa.ForeignKeyConstraint(["owner_id"], ["users.id"]),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("idempotency_key"),
    )
    op.create_index("ix_batches_owner_id", "batches", ["owner_id"], unique=False)
    op.create_table(
        "episode_labels",
        sa.Column("id", sa.String(length=32), nullable=False),
        sa.Column("episode_id", sa.String(length=32), nullable=False),
        sa.Column("label", sa.String(length=80), nullable=True),
        sa.Column("note", sa.String(), nullable=False),
        sa.Column("withdraws", sa.String(length=32), nullable=True),
        sa.Column("created", sa.DateTime(), nullable=False),
        sa.Column("author_id", sa.String(length=32), nullable=False),
        sa.ForeignKeyConstraint(["author_id"], ["users.id"]),
        sa.ForeignKeyConstraint(["episode_id"], ["episodes.id"]),
        sa.ForeignKeyConstraint(["withdraws"], ["episode_labels.id"]),
        sa.PrimaryKeyConstraint("id"),
        sa.UniqueConstraint("withdraws"),
    )
    op.create_index("ix_episode_labels_episode_id", "episode_labels", ["episode_id"])
    op.create_index("episode_labels_by_label", "episode_labels", ["label", "episode_id"])
    op.create_table(
        "leaderboard_snapshots",
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("content", sa.String(), nullable=False),
        sa.Column("split", sa.String(length=80), nullable=False),
        sa.Column("note", sa.String(), nullable=False),
        sa.Column("created", sa.DateTime(), nullable=False),
        sa.Column("owner_id", sa.String(length=32), nullable=True),
        sa.ForeignKeyConstraint(["owner_id"], ["users.id"]),
        sa.PrimaryKeyConstraint("number"),
        sa.UniqueConstraint("sha256"),
        sqlite_autoincrement=True,
    )
    for table, what, message in NEVER:
        op.execute(
            f"CREATE TRIGGER {table}_{what.lower()} BEFORE {what} ON {table} "
            f"FOR EACH ROW BEGIN SELECT RAISE(ABORT, '{message}'); END"
        )


def downgrade() -> None:
    for table in ("leaderboard_snapshots", "episode_labels", "batches"):
        op.drop_table(table)  # indexes and triggers go with it
