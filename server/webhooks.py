"""Webhooks: who is told what, and which deliveries wait, by https://www.standardwebhooks.com.

The ledger's events are the outbox. A webhook knows the last event of which its deliveries are
made; both move in one transaction, so a killed server neither forgets an event nor makes two
deliveries of it. What it had sent and not noted is sent again, under the same `webhook-id`.
"""

import json
import random
import secrets
from base64 import b64encode
from collections.abc import Collection, Sequence
from datetime import datetime, timedelta
from typing import Any, NamedTuple, TypeVar

from sqlalchemy import Select, delete, func, select
from sqlalchemy.orm import Session

from server.models import Delivery, Evaluation, Event, User, Webhook, new_id, now
from server.paging import after, page
from server.problems import Problem, invalid, not_found
from server.schemas.common import Page
from server.schemas.webhooks import DeliveryPublic, WebhookPublic
from server.states import DeliveryState, WebhookEvent
from workers.remote import egress

Wanted = TypeVar("Wanted", bound=Select[Any])
SCHEMES = ("https", "http")  # the latter only where the operator lets it
MOST = 10  # webhooks of one user
AT_ONCE = 500  # events that are looked at in one transaction
KEPT = timedelta(days=30)  # a delivery that is over
# s from one try to the next, as the specification suggests: three days in all
BACK_OFF = (5, 300, 1800, 7200, 18_000, 36_000, 50_400, 72_000, 86_400)
GONE = 410  # the receiver wants no more
NAMES = {  # events of the ledger whose kind says all
    "fault": WebhookEvent.EPISODE_FAULT,
    "divergence": WebhookEvent.EPISODE_DIVERGED,
}
STATED = {  # those that are told in one state
    ("episode", "final"): WebhookEvent.EPISODE_FINAL,
    ("attempt", "lost"): WebhookEvent.ATTEMPT_LOST,
}


class Outcome(NamedTuple):
    """What came of one try."""

    status: int | None = None  # as HTTP
    error: str | None = None

    @property
    def good(self) -> bool:
        """True if the receiver took it."""
        return self.status is not None and 200 <= self.status < 300


# --- who is told ---


def require_allowed(url: str, allowed: Sequence[str]) -> None:
    """Does nothing if deliveries may go there.

    Raises:
        Problem: 422, they may not, whatever the name stands for.
    """
    try:
        egress.foresee(egress.parse_url(url, SCHEMES), allowed)
    except egress.Forbidden as error:
        raise invalid("url", f"{error}") from None


def create(
    session: Session,
    owner: str,
    *,
    url: str,
    events: Sequence[WebhookEvent],
    everybodys: bool,
    description: str,
) -> Webhook:
    """A new webhook; it is told of what happens from now on.

    Raises:
        Problem: 429, its owner has too many.
    """
    count = select(func.count()).where(Webhook.owner_id == owner)
    if (session.scalar(count) or 0) >= MOST:
        detail = f"You have {MOST} webhooks; end one with DELETE."
        raise Problem(429, "too_many_webhooks", detail)
    row = Webhook(
        id=new_id("wh"),
        owner_id=owner,
        url=url,
        events=_names(events),
        everybodys=everybodys,
        description=description,
        secret=new_secret(),
        after=newest(session),
    )
    session.add(row)
    session.flush()
    return row


def new_secret() -> str:
    """What deliveries are signed with: 256 random bits, as the specification writes them."""
    return f"whsec_{b64encode(secrets.token_bytes(32)).decode()}"


def _names(events: Sequence[WebhookEvent]) -> list[str]:
    return [one.value for one in WebhookEvent if one in events]


def change(session: Session, row: Webhook, **changes: Any) -> None:
    """Sets what is given. One that is switched on again is told of what happens from then on."""
    if "events" in changes:
        changes["events"] = _names(changes["events"])
    if changes.get("active") and not row.active:
        changes["after"] = newest(session)
    if "active" in changes:
        changes["reason"] = None
    for field, value in changes.items():
        setattr(row, field, value)


def remove(session: Session, row: Webhook) -> None:
    """Ends a webhook, and forgets its deliveries."""
    session.execute(delete(Delivery).where(Delivery.webhook_id == row.id))
    session.delete(row)


def find(session: Session, id: str, owner: str) -> Webhook:
    """The user's webhook with this id; nobody else learns that it is there.

    Raises:
        Problem: 404, there is none.
    """
    row = session.get(Webhook, id)
    if row is None or row.owner_id != owner:
        raise not_found("webhook", id)
    return row


def listed(session: Session, owner: str) -> list[WebhookPublic]:
    """A user's webhooks, the newest first."""
    wanted = select(Webhook).where(Webhook.owner_id == owner).order_by(Webhook.id.desc())
    return [WebhookPublic.model_validate(one) for one in session.scalars(wanted)]


# --- what is told ---


def newest(session: Session) -> int:
    """The number of the ledger's newest event."""
    return session.scalar(select(func.max(Event.seq))) or 0


def behind(session: Session) -> bool:
    """True if there are events of which some webhook's deliveries are not made yet."""
    active = select(Webhook.id).where(Webhook.active, Webhook.after < newest(session))
    return session.scalar(active.limit(1)) is not None


def collect(session: Session) -> None:
    """Makes deliveries of the events since the last time."""
    last = newest(session)
    behind = select(Webhook).where(Webhook.active, Webhook.after < last)
    for hook in session.scalars(behind).all():
        found = session.execute(
            select(Event, Evaluation)
            .join(Evaluation, Event.evaluation_id == Evaluation.id)
            .where(Event.seq > hook.after)
            .order_by(Event.seq)
            .limit(AT_ONCE)
        ).all()
        for event, evaluation in found:
            kind = kind_of(event)
            if kind is None or kind not in hook.events:
                continue
            if hook.everybodys or evaluation.owner_id == hook.owner_id:
                data = _data(event, evaluation)
                add(session, hook, kind, data, time=event.time, event=event.seq)
        hook.after = found[-1][0].seq if len(found) == AT_ONCE else last


def kind_of(event: Event) -> WebhookEvent | None:
    """What webhooks call an event; None for what they are not told."""
    if event.kind in NAMES:
        return NAMES[event.kind]
    state = event.payload.get("state")
    if event.kind == "evaluation":
        known = {one.value: one for one in WebhookEvent}
        return known.get(f"evaluation.{state}")
    return STATED.get((event.kind, str(state)))


def _data(event: Event, evaluation: Evaluation) -> dict[str, Any]:
    version = evaluation.policy_version
    return {
        "event": event.seq,
        "evaluation": evaluation.id,
        "policy": version.policy.name,
        "version": version.number,
        "path": f"/api/v1/evaluations/{evaluation.id}",
        **event.payload,
    }


def add(
    session: Session,
    hook: Webhook,
    kind: WebhookEvent,
    data: dict[str, Any],
    *,
    time: datetime,
    event: int | None = None,
) -> Delivery:
    """A delivery that waits."""
    body = {"type": kind.value, "timestamp": time.isoformat(), "data": data}
    text = json.dumps(body, separators=(",", ":"), ensure_ascii=False)
    row = Delivery(
        id=new_id("msg"),
        webhook_id=hook.id,
        event_seq=event,
        kind=kind.value,
        body=text,
        state=DeliveryState.PENDING,
        tries=[],
        due=now(),
        created=now(),
    )
    session.add(row)
    return row


# --- how it goes ---


def due(session: Session, moment: datetime, busy: Collection[str] = ()) -> list[Delivery]:
    """For each active webhook, of users who may come in, the delivery that is due the longest.

    Args:
        busy: webhooks that are left out.
    """
    hooks = _waiting(select(Delivery.webhook_id), busy).where(Delivery.due <= moment)
    ids = session.scalars(hooks.group_by(Delivery.webhook_id).order_by(func.min(Delivery.due)))
    first = (
        select(Delivery)
        .where(Delivery.state == DeliveryState.PENDING)
        .order_by(Delivery.due, Delivery.number)
        .limit(1)
    )
    found = [session.scalar(first.where(Delivery.webhook_id == id)) for id in ids.all()]
    return [row for row in found if row]


def next_due(session: Session, busy: Collection[str] = ()) -> datetime | None:
    """When the next delivery is to be tried, those of busy webhooks apart."""
    return session.scalar(_waiting(select(func.min(Delivery.due)), busy))


def _waiting(wanted: Wanted, busy: Collection[str]) -> Wanted:
    return (
        wanted.join(Webhook, Webhook.id == Delivery.webhook_id)
        .join(User, User.id == Webhook.owner_id)
        .where(Delivery.state == DeliveryState.PENDING, Webhook.active, User.active)
        .where(Webhook.id.not_in(list(busy)))
    )


def note(row: Delivery, outcome: Outcome, moment: datetime) -> None:
    """What came of a try; the next one follows later each time, until they are used up."""
    told = {"time": moment.isoformat(), "status": outcome.status, "error": outcome.error}
    row.tries = [*row.tries, told]
    if outcome.good:
        row.state, row.due = DeliveryState.DELIVERED, None
    elif outcome.status == GONE:
        _give_up(row, "its receiver answered that it is gone (410)")
    elif len(row.tries) > len(BACK_OFF):
        _give_up(row, f"its receiver took nothing in {len(row.tries)} tries")
    else:
        wait = BACK_OFF[len(row.tries) - 1] * random.uniform(1.0, 1.1)  # not all at a time
        row.due = moment + timedelta(seconds=wait)


def _give_up(row: Delivery, reason: str) -> None:
    """What waits besides is sent when the webhook is switched on again."""
    row.state, row.due = DeliveryState.FAILED, None
    row.webhook.active, row.webhook.reason = False, reason


def delivery(session: Session, id: str) -> Delivery | None:
    """The delivery with this id, if it is there still."""
    return session.scalar(select(Delivery).where(Delivery.id == id))


def deliver_again(session: Session, hook: Webhook, id: str) -> Delivery:
    """Sends a delivery that is over, or waits, now; its tries are counted anew.

    Raises:
        Problem: 404, there is none.
    """
    row = delivery(session, id)
    if row is None or row.webhook_id != hook.id:
        raise not_found("delivery", id)
    row.state, row.due, row.tries = DeliveryState.PENDING, now(), []
    return row


def deliveries(
    session: Session,
    hook: Webhook,
    *,
    state: DeliveryState | None = None,
    limit: int = 50,
    cursor: str | None = None,
) -> Page[DeliveryPublic]:
    """A webhook's deliveries, the newest first.

    Raises:
        Problem: 422, the cursor is not ours.
    """
    wanted = select(Delivery).where(Delivery.webhook_id == hook.id)
    if state is not None:
        wanted = wanted.where(Delivery.state == state)
    if place := after(cursor, [int]):
        wanted = wanted.where(Delivery.number < place[0])
    rows = session.scalars(wanted.order_by(Delivery.number.desc()).limit(limit + 1)).all()
    return page(rows, limit, lambda one: [one.number], DeliveryPublic.model_validate)


def prune(session: Session, moment: datetime) -> None:
    """Forgets deliveries that have been over for long."""
    session.execute(
        delete(Delivery).where(
            Delivery.state != DeliveryState.PENDING, Delivery.created < moment - KEPT
        )
    )
