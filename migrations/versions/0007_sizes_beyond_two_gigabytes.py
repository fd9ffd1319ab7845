"""Sizes of blobs beyond 2 GiB: PostgreSQL's INTEGER ends there, SQLite's does not."""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    _size(sa.BigInteger())


def downgrade() -> None:
    _size(sa.Integer())


def _size(kind: sa.types.TypeEngine[int]) -> None:
    if op.get_bind().dialect.name == "postgresql":
        op.alter_column("blobs", "size", type_=kind)
