"""Webhooks of one's own: whom to tell what, what was delivered, and what was not."""

from typing import Annotated, Any

from fastapi import Form, Query, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse
from pydantic import ValidationError

from server import webhooks
from server.access import Router, Scope, needs
from server.deps import Cursor, Reading, TheHub, ThePrincipal
from server.problems import Problem, of_validation
from server.routes import webhooks as api
from server.schemas.webhooks import WHEN_ENDED, WebhookChange, WebhookCreate, WebhookPublic
from server.states import DeliveryState, WebhookEvent
from web.filters import EMPTY_IS_NONE
from web.templating import page

PATH = "/account/webhooks"
router = Router(prefix=PATH, include_in_schema=False)

LISTED = 50
NOT_KEPT = {"Cache-Control": "no-store"}  # a page with a secret
OFFERED = [one for one in WebhookEvent if one is not WebhookEvent.TRIAL]
Text = Annotated[str, Form(max_length=2000)]


@router.get("")
@needs(Scope.SUBMIT)
def list_webhooks(request: Request, session: Reading, principal: ThePrincipal) -> HTMLResponse:
    """One's own, the newest first, and the form that makes one."""
    return _list(request, webhooks.listed(session, principal.user))


@router.post("")
@needs(Scope.SUBMIT)
def create_webhook(
    request: Request,
    principal: ThePrincipal,
    hub: TheHub,
    events: Annotated[list[WebhookEvent] | None, Form()] = None,
    url: Text = "",
    description: Text = "",
    everybodys: Annotated[bool, Form()] = False,
) -> Response:
    """A new webhook; its secret is shown on this page and never again."""
    given = {"url": url.strip(), "events": events or [], "everybodys": everybodys}
    given["description"] = description
    try:
        created = api.create_webhook(_wanted(given), hub, principal, Response())
    except Problem as problem:
        with hub.database.reading() as session:
            found = webhooks.listed(session, principal.user)
        return _list(request, found, given, problem)
    with hub.database.reading() as session:
        return _show(request, session, principal, created.id, secret=created.secret)


def _wanted(given: dict[str, Any]) -> WebhookCreate:
    try:
        return WebhookCreate.model_validate(given)
    except ValidationError as error:
        raise of_validation(error.errors()) from None


@router.get("/{webhook}")
@needs(Scope.SUBMIT)
def show_webhook(
    request: Request,
    session: Reading,
    principal: ThePrincipal,
    webhook: str,
    state: Annotated[DeliveryState | None, Query(), EMPTY_IS_NONE] = None,
    cursor: Cursor = None,
) -> HTMLResponse:
    """One webhook and its deliveries, the newest first."""
    return _show(request, session, principal, webhook, state=state, cursor=cursor)


@router.post("/{webhook}/activity")
@needs(Scope.SUBMIT)
def switch(
    webhook: str, principal: ThePrincipal, hub: TheHub, active: Annotated[bool, Form()]
) -> Response:
    """Switches it on or off."""
    api.change_webhook(webhook, WebhookChange(active=active), hub, principal)
    return _back(webhook)


@router.post("/{webhook}/secret")
@needs(Scope.SUBMIT)
def renew_secret(
    request: Request, webhook: str, principal: ThePrincipal, hub: TheHub
) -> HTMLResponse:
    """Another secret, shown on this page and never again."""
    renewed = api.renew_secret(webhook, hub, principal)
    with hub.database.reading() as session:
        return _show(request, session, principal, webhook, secret=renewed.secret)


@router.post("/{webhook}/trial")
@needs(Scope.SUBMIT)
def send_trial(webhook: str, principal: ThePrincipal, hub: TheHub) -> Response:
    """Sends something, to see whether it arrives."""
    api.try_webhook(webhook, hub, principal)
    return _back(webhook)


@router.post("/{webhook}/removal")
@needs(Scope.SUBMIT)
def remove_webhook(webhook: str, principal: ThePrincipal, hub: TheHub) -> Response:
    """Ends it; its deliveries are forgotten."""
    api.remove_webhook(webhook, hub, principal)
    return RedirectResponse(PATH, 303)


@router.post("/{webhook}/deliveries/{delivery}/repetition")
@needs(Scope.SUBMIT)
def deliver_again(webhook: str, delivery: str, principal: ThePrincipal, hub: TheHub) -> Response:
    """Sends a delivery once more, now."""
    api.deliver_again(webhook, delivery, hub, principal)
    return _back(webhook)


def _back(webhook: str) -> Response:
    return RedirectResponse(f"{PATH}/{webhook}#deliveries", 303)


def _list(
    request: Request,
    found: list[WebhookPublic],
    given: dict[str, Any] | None = None,
    problem: Problem | None = None,
) -> HTMLResponse:
    shown = {
        "found": found,
        "given": given or {"events": WHEN_ENDED, "url": "", "description": "", "everybodys": False},
        "offered": OFFERED,
        "most": webhooks.MOST,
        "problem": problem.detail if problem else "",
    }
    status = problem.status if problem else 200
    return page(request, "webhooks.html", shown, status=status)


def _show(
    request: Request,
    session: Reading,
    principal: ThePrincipal,
    id: str,
    *,
    state: DeliveryState | None = None,
    cursor: str | None = None,
    secret: str = "",
) -> HTMLResponse:
    row = webhooks.find(session, id, principal.user)
    shown = {
        "webhook": WebhookPublic.model_validate(row),
        "found": webhooks.deliveries(session, row, state=state, limit=LISTED, cursor=cursor),
        "states": list(DeliveryState),
        "state": state,
        "cursor": cursor,
        "secret": secret,
    }
    return page(request, "webhook.html", shown, headers=NOT_KEPT if secret else None)
