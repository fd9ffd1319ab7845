"""What was tried of a policy's version when it came."""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"


def upgrade() -> None:
    """Not in batch mode, which would copy the table without its triggers."""
    op.add_column("policy_versions", sa.Column("checks", sa.JSON(), nullable=True))


def downgrade() -> None:
    """The column goes."""
    op.drop_column("policy_versions", "checks")
