"""Of which suite a snapshot is; there was one when the earlier ones were taken."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"


def upgrade() -> None:
    """Not in batch mode, which would copy the table without its triggers; those let no row be
    changed either, so the default says what the earlier ones are."""
    suite = sa.Column("suite", sa.String(length=80), nullable=False, server_default="hide")
    op.add_column("leaderboard_snapshots", suite)


def downgrade() -> None:
    """The column goes."""
    op.drop_column("leaderboard_snapshots", "suite")
