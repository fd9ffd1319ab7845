"""Webhooks: where a user wants to be told what happens, and how that went."""

from typing import Any

from fastapi import Response

from server import webhooks
from server.access import Router, Scope, needs
from server.deps import Cursor, Limit, Reading, TheHub, ThePrincipal
from server.models import Webhook, now
from server.schemas.common import Page
from server.schemas.webhooks import (
    DeliveryPublic,
    WebhookChange,
    WebhookCreate,
    WebhookCreated,
    WebhookPublic,
)
from server.states import DeliveryState, WebhookEvent

router = Router(prefix="/webhooks", tags=["webhooks"])


@router.get("")
@needs(Scope.SUBMIT)
def list_webhooks(session: Reading, principal: ThePrincipal) -> list[WebhookPublic]:
    """One's own webhooks, the newest first."""
    return webhooks.listed(session, principal.user)


@router.post("", status_code=201)
@needs(Scope.SUBMIT)
def create_webhook(
    wanted: WebhookCreate, hub: TheHub, principal: ThePrincipal, response: Response
) -> WebhookCreated:
    """An address that is told what happens from now on; its secret is told only now."""
    webhooks.require_allowed(wanted.url, hub.settings.allow_webhook)
    with hub.database.writing() as session:
        row = webhooks.create(session, principal.user, **dict(wanted))
        created = _with_secret(row)
    response.headers["Location"] = f"/api/v1/webhooks/{row.id}"
    return created


@router.get("/{webhook}")
@needs(Scope.SUBMIT)
def get_webhook(webhook: str, session: Reading, principal: ThePrincipal) -> WebhookPublic:
    """One webhook of one's own."""
    return WebhookPublic.model_validate(webhooks.find(session, webhook, principal.user))


@router.post("/{webhook}/changes")
@needs(Scope.SUBMIT)
def change_webhook(
    webhook: str, wanted: WebhookChange, hub: TheHub, principal: ThePrincipal
) -> WebhookPublic:
    """Sets what is given; one that was switched off goes on with what happens from then on."""
    changes: dict[str, Any] = {name: getattr(wanted, name) for name in wanted.model_fields_set}
    if "url" in changes:
        webhooks.require_allowed(changes["url"], hub.settings.allow_webhook)
    with hub.database.writing() as session:
        row = webhooks.find(session, webhook, principal.user)
        webhooks.change(session, row, **changes)
        return WebhookPublic.model_validate(row)


@router.post("/{webhook}/secret")
@needs(Scope.SUBMIT)
def renew_secret(webhook: str, hub: TheHub, principal: ThePrincipal) -> WebhookCreated:
    """A new secret in place of the one before, which signs nothing any more."""
    with hub.database.writing() as session:
        row = webhooks.find(session, webhook, principal.user)
        row.secret = webhooks.new_secret()
        return _with_secret(row)


@router.delete("/{webhook}", status_code=204)
@needs(Scope.SUBMIT)
def remove_webhook(webhook: str, hub: TheHub, principal: ThePrincipal) -> Response:
    """Ends a webhook; its deliveries are forgotten."""
    with hub.database.writing() as session:
        webhooks.remove(session, webhooks.find(session, webhook, principal.user))
    return Response(status_code=204)


@router.post("/{webhook}/trial", status_code=202)
@needs(Scope.SUBMIT)
def try_webhook(webhook: str, hub: TheHub, principal: ThePrincipal) -> DeliveryPublic:
    """Sends a `webhook.trial`."""
    with hub.database.writing() as session:
        row = webhooks.find(session, webhook, principal.user)
        sent = webhooks.add(session, row, WebhookEvent.TRIAL, {"webhook": row.id}, time=now())
        session.flush()
        return DeliveryPublic.model_validate(sent)


@router.get("/{webhook}/deliveries")
@needs(Scope.SUBMIT)
def list_deliveries(
    webhook: str,
    session: Reading,
    principal: ThePrincipal,
    state: DeliveryState | None = None,
    limit: Limit = 50,
    cursor: Cursor = None,
) -> Page[DeliveryPublic]:
    """What was sent, and is to be sent, the newest first, with every try; kept for 30 days."""
    row = webhooks.find(session, webhook, principal.user)
    return webhooks.deliveries(session, row, state=state, limit=limit, cursor=cursor)


@router.post("/{webhook}/deliveries/{delivery}/repetition", status_code=202)
@needs(Scope.SUBMIT)
def deliver_again(
    webhook: str, delivery: str, hub: TheHub, principal: ThePrincipal
) -> DeliveryPublic:
    """Sends a delivery once more, now, under the same `webhook-id`."""
    with hub.database.writing() as session:
        row = webhooks.find(session, webhook, principal.user)
        sent = webhooks.deliver_again(session, row, delivery)
        return DeliveryPublic.model_validate(sent)


def _with_secret(row: Webhook) -> WebhookCreated:
    public = WebhookPublic.model_validate(row)
    return WebhookCreated(**public.model_dump(), secret=row.secret)
