"""Checks of every request, before any other part of the app sees it."""

import asyncio
import secrets
from urllib.parse import parse_qs, quote, unquote, urlsplit

from fastapi import HTTPException
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from nearfar.app.configuration import MEGABYTE, AppConfiguration, Limits, is_loopback

COOKIE = "nearfar-token"
"""Start of the name of the cookie with the token; the port of this server follows."""
UPLOADS = "/api/images"
"""Path to which images are sent, which may be large."""
_WITH_BODY = ("POST", "PUT", "PATCH")

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class Guard:
    """Refuses requests from other sites, without the token, too many, too large or too slow.

    Requests with a body take at most half of the places, so that slow senders leave the others.

    Args:
        app: the app that answers all other requests.
        configuration: host, token and limits.
    """

    def __init__(self, app: ASGIApp, configuration: AppConfiguration) -> None:
        self._app = app
        self._configuration = configuration
        self._under_way = 0
        self._bodies = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers[name] = value
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        refusal = self._refusal(scope)
        if refusal is not None:
            await refusal(scope, receive, send_guarded)
            return
        with_body = scope["method"] in _WITH_BODY
        self._under_way += 1
        self._bodies += with_body
        try:
            limited = _Limited(receive, self._most_bytes(scope), self._configuration.limits)
            await self._app(scope, limited, send_guarded)
        finally:
            self._under_way -= 1
            self._bodies -= with_body

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        most, with_body = self._configuration.limits.requests, scope["method"] in _WITH_BODY
        if self._under_way >= most or (with_body and self._bodies >= most // 2):
            return _refused(503, "too many requests at a time: try again", {"Retry-After": "1"})
        if self._configuration.local and not is_loopback(_host_name(headers.get("host", ""))):
            return _refused(421, "this server answers to the name of this machine only")
        if not _same_origin(headers, scope["path"]):
            return _refused(403, "requests of other sites are refused")
        entrance = self._entrance(scope, headers)
        if entrance is not None:
            return entrance
        length = headers.get("content-length", "0")
        if not length.isascii() or not length.isdigit():
            return _refused(400, "the length of the request is not a number")
        most_bytes = self._most_bytes(scope)
        if int(length[:20]) > most_bytes:
            return _refused(413, _too_large(most_bytes))
        return None

    def _entrance(self, scope: Scope, headers: Headers) -> Response | None:
        """Return None for a request with the token, else a refusal or the cookie with the token."""
        token = self._configuration.token
        cookie = _cookie(scope)
        if token is None or any(_equal(given, token) for given in _given(headers, cookie)):
            return None
        asked = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if scope["path"] == "/" and _equal(asked, token):
            response = RedirectResponse("/", 303)
            response.set_cookie(cookie, quote(token, safe=""), httponly=True, samesite="strict")
            return response
        return _refused(401, "open the address that nearfar app has printed, with its token")

    def _most_bytes(self, scope: Scope) -> int:
        limits = self._configuration.limits
        sending = scope["method"] == "POST" and scope["path"] == UPLOADS
        return limits.upload_bytes if sending else limits.body_bytes


class _Limited:
    """Receives a body, up to a number of bytes, and not slower than a rate.

    Args:
        receive: gives the parts of the body.
        most_bytes: largest size of the body.
        limits: bounds of its time.
    """

    def __init__(self, receive: Receive, most_bytes: int, limits: Limits) -> None:
        self._receive = receive
        self._most_bytes = most_bytes
        self._limits = limits
        self._received = 0
        self._whole = False
        self._start = asyncio.get_running_loop().time()

    async def __call__(self) -> Message:
        if self._whole:  # What comes now is the end of the connection.
            return await self._receive()
        allowed = self._limits.body_seconds + self._received / self._limits.least_rate
        try:
            async with asyncio.timeout_at(self._start + allowed):
                message = await self._receive()
        except TimeoutError:
            raise HTTPException(408, "the request did not arrive in time") from None
        self._received += len(message.get("body", b""))
        self._whole = not message.get("more_body", False)
        if self._received > self._most_bytes:
            raise HTTPException(413, _too_large(self._most_bytes))
        return message


def _too_large(most_bytes: int) -> str:
    return f"the request is larger than the limit of {most_bytes / MEGABYTE:g} megabytes"


def _same_origin(headers: Headers, path: str) -> bool:
    """Whether a request comes from a page of this server, or from no page at all."""
    origin = headers.get("origin")
    if origin is not None:
        try:
            return urlsplit(origin).netloc == headers.get("host") and origin != "null"
        except ValueError:
            return False
    site = headers.get("sec-fetch-site", "none")
    return site in ("same-origin", "none") or not path.startswith("/api/")


def _cookie(scope: Scope) -> str:
    """Return the name of the cookie with the token.

    Browsers send the cookies of all ports of a host to each, so that two servers of one host would
    replace each other's cookie if it had one name.
    """
    server = scope.get("server")
    return COOKIE if server is None or server[1] is None else f"{COOKIE}-{server[1]}"


def _given(headers: Headers, cookie: str) -> list[str]:
    """Return the tokens that a request brings.

    Other programs of this host may have set cookies of any form and of the same name. So a cookie
    that cannot be read hides no other one, and each one of the name counts.
    """
    given = []
    scheme, _, value = headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        given.append(value.strip())
    for pair in ";".join(headers.getlist("cookie")).split(";"):
        name, _, value = pair.partition("=")
        if name.strip() == cookie:
            given.append(unquote(value.strip()))
    return given


def _equal(given: str, token: str) -> bool:
    return secrets.compare_digest(given.encode(), token.encode())


def _host_name(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _refused(status: int, detail: str, headers: dict[str, str] | None = None) -> Response:
    return JSONResponse({"detail": detail}, status, headers)
