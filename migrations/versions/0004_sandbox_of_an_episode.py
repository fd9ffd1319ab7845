"""Which sandbox was around the policy's process in an episode."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Not in batch mode, which would copy the table without its triggers."""
    op.add_column("episodes", sa.Column("sandbox", sa.String(length=80), nullable=True))


def downgrade() -> None:
    """The column goes."""
    op.drop_column("episodes", "sandbox")
