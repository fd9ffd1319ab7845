"""Lets requests in: who asks, how often, whether they may, and whether their own page asks.

Nothing of a body is read for somebody who may not send it, and what was changed, or refused to
somebody who is known, enters the audit log.
"""

import asyncio
import hmac
import time
from ipaddress import IPv6Address, ip_address, ip_network

from fastapi import Request
from fastapi.responses import Response
from limits import RateLimitItem, parse
from limits.storage import MemoryStorage
from limits.strategies import SlidingWindowCounterRateLimiter
from sqlalchemy.orm import Session

from server import audit, credentials, users
from server.access import Gate, Handle, Need, Principal, Scope
from server.credentials import unauthorised
from server.guard import SAFE
from server.hub import Hub
from server.models import User, now
from server.problems import Problem

FORM = "application/x-www-form-urlencoded"
CSRF_HEADER, CSRF_FIELD = "x-csrf-token", "csrf"
REFUSED = (403, 429)


class Admission:
    """What every request for a route passes (server/access.py)."""

    def __init__(self, hub: Hub):
        self.hub = hub
        self._limiter = SlidingWindowCounterRateLimiter(MemoryStorage())
        self._known = parse(hub.settings.rate)
        self._unknown = parse(hub.settings.rate_unknown)
        self._sign_in = parse(hub.settings.rate_sign_in)

    async def __call__(self, request: Request, need: Need, handle: Handle) -> Response:
        """The answer of a route to whoever may ask it.

        Raises:
            Problem: 401, it is not known who asks; 403, they may not; 429, too often.
        """
        if need is Gate.WORKER:
            return await handle(request)
        principal = await self._identified(request)
        request.state.principal = principal
        try:
            self._limit(request, principal)
            _require(principal, need)
            await _require_own_page(request, principal)
            response = await handle(request)
        except Problem as problem:
            if problem.status in REFUSED:
                await self._note(request, principal, request.url.path, problem.status)
            raise
        if response.status_code < 400:
            subject = response.headers.get("location", request.url.path)
            await self._note(request, principal, subject, response.status_code)
        return response

    # --- who asks ---

    async def _identified(self, request: Request) -> Principal | None:
        """Whoever the request proves to be; the owner, where nothing is asked for."""
        shown = request.headers.get("authorization")
        if shown is not None:
            return await asyncio.to_thread(self._of_header, shown)
        if secret := request.cookies.get(cookie_name(self.hub)):
            known = await asyncio.to_thread(self._of_cookie, secret)
            if known is not None:
                return known
        return self.hub.owner if self.hub.settings.is_open else None

    def _of_header(self, shown: str) -> Principal:
        scheme, _, text = shown.partition(" ")
        id, secret = credentials.parts(text.strip())
        if scheme.lower() != "bearer" or not id:
            raise unauthorised("Authorization: Bearer hide_…, a token of this server, is wanted.")
        if id == credentials.LOCAL:
            return self._of_local(text.strip())
        with self.hub.database.reading() as session:
            principal = credentials.of_token(session, id, secret)
            stale = credentials.is_stale(session, id)
        if stale:
            with self.hub.database.writing() as session:
                credentials.token(session, id).last_used = now()
        return principal

    def _of_local(self, text: str) -> Principal:
        if not self._is_printed(text):
            raise unauthorised("This is not the token that the server printed when it started.")
        return self.hub.owner

    def _is_printed(self, text: str) -> bool:
        printed = self.hub.local_token
        return printed is not None and hmac.compare_digest(printed.encode(), text.encode())

    def _of_cookie(self, secret: str) -> Principal | None:
        with self.hub.database.reading() as session:
            found = credentials.of_cookie(session, secret)
        local = self.hub.settings.auth == "local"
        return found if found and (found.user == self.hub.owner.user) == local else None

    # --- how often ---

    def _limit(self, request: Request, principal: Principal | None) -> None:
        if self.hub.settings.is_open:
            return
        if principal is None:
            self._hit(self._unknown, "address", network_of(address_of(request)))
        else:
            self._hit(self._known, "user", principal.user)

    def _limit_sign_in(self, request: Request, name: str) -> None:
        """Counts a try to sign in.

        Raises:
            Problem: 429, there were too many from this address or at this name.
        """
        self._hit(self._sign_in, "sign-in-address", network_of(address_of(request)))
        self._hit(self._sign_in, "sign-in-name", name)

    def sign_in(self, request: Request, name: str, password: str) -> str:
        """Lets a browser in; the secret that its cookie holds. In local mode the token is shown.

        Raises:
            Problem: 401, the name or the password is wrong; 429, too many tries.
        """
        user = self.require_password(request, name, password)
        with self.hub.database.writing() as session:
            secret = credentials.sign_in(session, session.get_one(User, user))
            self._note_sign_in(session, request, name, 303)
        return secret

    def require_password(self, request: Request, name: str, password: str) -> str:
        """The id of the user whose password this is.

        Raises:
            Problem: 401, it is not; 429, too many tries.
        """
        self._limit_sign_in(request, name)
        if (user := self._whose(name, password)) is not None:
            return user
        with self.hub.database.writing() as session:
            self._note_sign_in(session, request, name, 401)
        raise unauthorised("This name and password do not go together.")

    def _whose(self, name: str, password: str) -> str | None:
        if self.hub.settings.auth == "local":
            return self.hub.owner.user if self._is_printed(password) else None
        with self.hub.database.reading() as session:
            user = users.checked(session, name, password)
            return user.id if user else None

    def _note_sign_in(self, session: Session, request: Request, name: str, status: int) -> None:
        address = address_of(request)
        audit.note(
            session, "sign_in", "", principal=None, name=name, address=address, status=status
        )

    def _hit(self, rate: RateLimitItem, *whose: str) -> None:
        if self._limiter.hit(rate, *whose):
            return
        reset = self._limiter.get_window_stats(rate, *whose).reset_time
        wait = str(max(1, int(reset - time.time()) + 1))
        detail = f"More than {rate.amount} requests per {rate.GRANULARITY.name}; wait {wait} s."
        raise Problem(429, "too_often", detail, headers={"Retry-After": wait})

    # --- what is kept of it ---

    async def _note(
        self, request: Request, principal: Principal | None, subject: str, status: int
    ) -> None:
        if (request.method in SAFE and status not in REFUSED) or principal is None:
            return
        await asyncio.to_thread(self._write, request, principal, subject, status)

    def _write(self, request: Request, principal: Principal, subject: str, status: int) -> None:
        action = request.scope["route"].name
        address = address_of(request)
        with self.hub.database.writing() as session:
            audit.note(
                session, action, subject, principal=principal, address=address, status=status
            )


def cookie_name(hub: Hub) -> str:
    """The cookie of a sign-in; with TLS no other host and no plain page can set it."""
    return "__Host-hide" if hub.settings.secure else "hide"


def address_of(request: Request) -> str:
    """The client's address, as far as it is known."""
    return request.client.host if request.client else ""


def network_of(address: str) -> str:
    """Whom an address stands for: of IPv6, everybody gets 2**64."""
    try:
        found = ip_address(address)
    except ValueError:
        return address
    return str(ip_network((found, 64), strict=False)) if isinstance(found, IPv6Address) else address


def _require(principal: Principal | None, need: Need) -> None:
    if need is Gate.PUBLIC:
        return
    if principal is None:
        raise unauthorised("Sign in, or send Authorization: Bearer and a token of this server.")
    if isinstance(need, Scope) and not principal.may(need):
        has = ", ".join(scope for scope in Scope if principal.may(scope)) or "nothing"
        whose = "this token" if principal.via == "token" else f"a {principal.role}"
        raise Problem(403, "not_allowed", f"This needs the scope {need}; {whose} has {has}.")


async def _require_own_page(request: Request, principal: Principal | None) -> None:
    """A browser sends its cookie along whichever page asks; only ours know what goes with it."""
    if principal is None or principal.via != "session" or request.method in SAFE:
        return
    shown = request.headers.get(CSRF_HEADER)
    if shown is None and request.headers.get("content-type", "").startswith(FORM):
        shown = str((await request.form()).get(CSRF_FIELD, ""))
    if not hmac.compare_digest((shown or "").encode(), principal.csrf.encode()):
        raise Problem(403, "csrf", "The page is not of this sign-in; load it again.")
