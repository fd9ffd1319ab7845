"""On what machine an attempt played: hashes of states hold on machines alike."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"


def upgrade() -> None:
    """Not in batch mode, which would copy the table without its triggers."""
    op.add_column("attempts", sa.Column("machine", sa.JSON(), nullable=True))


def downgrade() -> None:
    """The column goes."""
    op.drop_column("attempts", "machine")
