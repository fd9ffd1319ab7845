"""Who changed what, and who was refused; entries are only ever added."""

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.access import Principal
from server.models import AuditEntry
from server.paging import after, page
from server.schemas.common import Page
from server.schemas.people import AuditEntryPublic

LONGEST = 300  # characters of a subject


def note(
    session: Session,
    action: str,
    subject: str,
    *,
    principal: Principal | None,
    name: str = "",
    via: str = "none",
    address: str = "",
    status: int = 200,
) -> None:
    """Adds an entry.

    Args:
        name, via: of whoever it is when there is no principal: a try to sign in, a command.
    """
    if principal is not None:
        name, via = principal.name, f"{principal.via} {principal.credential[:26]}".rstrip()
    session.add(
        AuditEntry(
            user_id=principal.user if principal else None,
            name=name[:80],
            via=via,
            address=address[:80],
            action=action[:80],
            subject=subject[:LONGEST],
            status=status,
        )
    )


def listed(
    session: Session, *, user: str | None = None, limit: int = 50, cursor: str | None = None
) -> Page[AuditEntryPublic]:
    """Entries, the newest first; of one user's name, if one is given.

    Raises:
        Problem: 422, the cursor is not ours.
    """
    wanted = select(AuditEntry).order_by(AuditEntry.seq.desc()).limit(limit + 1)
    if user is not None:
        wanted = wanted.where(AuditEntry.name == user)
    if place := after(cursor, [int]):
        wanted = wanted.where(AuditEntry.seq < place[0])
    rows = session.scalars(wanted).all()
    return page(rows, limit, lambda one: [one.seq], AuditEntryPublic.model_validate)
