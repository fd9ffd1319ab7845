"""What is known of a policy version's memory: read from its checkpoint, or declared."""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"


def upgrade() -> None:
    """Not in batch mode, which would copy the table without its triggers."""
    op.add_column("policy_versions", sa.Column("facts", sa.JSON(), nullable=True))


def downgrade() -> None:
    """The column goes."""
    op.drop_column("policy_versions", "facts")
