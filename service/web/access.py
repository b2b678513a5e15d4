"""Who may see the page: the token, and requests that another site makes a browser send."""

import hmac
from collections import OrderedDict
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from starlette.datastructures import Headers

from service.allowance import Allowance
from service.web.options import PageOptions

_TRIES_A_SECOND, _TRIES_AT_ONCE = 0.1, 10.0
_REMEMBERED = 1000
"""Addresses whose tries are counted."""

_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})


class Access:
    """Decides by the headers of a request.

    The cookie is derived from the token, so that it outlives a restart of the server and ends with the token.

    Args:
        options: of the server.
    """

    def __init__(self, options: PageOptions) -> None:
        self._secret, self._is_loopback = options.secret, options.is_loopback
        self._cookie = "" if self._secret is None else _derived(self._secret)
        self._tries: OrderedDict[str, Allowance] = OrderedDict()

    def fault(self, headers: Headers) -> str | None:
        """Why a request may not even ask for the token; None = it may.

        On loopback the name in `Host` must be the machine's own: another name means that a site has had its
        name resolve to this machine (DNS rebinding). `Origin`, where there is one, must be the page's own.
        """
        host = headers.get("host", "")
        if self._is_loopback and _name(host) not in _LOOPBACK:
            return f"the host {host[:80]!r} is not this machine: open http://localhost instead"
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return f"a page of {origin[:80]!r} may not use this one"
        return None

    def admits(self, headers: Headers) -> bool:
        """Whether a request brings the token, in its cookie or as a bearer's; or none is needed."""
        if self._secret is None:
            return True
        kind, _, told = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer" and self.is_token(told):
            return True
        return hmac.compare_digest(self._brought(headers).encode(), self._cookie.encode())

    def is_token(self, told: str) -> bool:
        """Whether it is the token; takes as long for a wrong one."""
        return self._secret is not None and hmac.compare_digest(
            told.encode(errors="surrogatepass"), self._secret.encode()
        )

    def may_try(self, address: str) -> bool:
        """Whether somebody at this address may try a token now; counts as a try."""
        allowance = self._tries.pop(address, None) or Allowance(_TRIES_A_SECOND, _TRIES_AT_ONCE)
        self._tries[address] = allowance
        while len(self._tries) > _REMEMBERED:
            self._tries.popitem(last=False)
        return allowance.spend()

    def cookie(self, headers: Headers) -> str:
        """`Set-Cookie` for who has told the token."""
        return f"{_cookie_name(headers)}={self._cookie}; Path=/; Max-Age=31536000; HttpOnly; SameSite=Strict"

    def _brought(self, headers: Headers) -> str:
        try:
            found = SimpleCookie(headers.get("cookie", "")).get(_cookie_name(headers))
        except CookieError:
            return ""
        return "" if found is None else found.value


def _cookie_name(headers: Headers) -> str:
    """Cookies are sent to every port of a host: two pages on one need two names."""
    port = headers.get("host", "").rpartition(":")[2]
    return f"lidarboost-{port if port.isdecimal() else 'page'}"


def _derived(secret: str) -> str:
    return hmac.digest(secret.encode(), b"lidarboost live page", "sha256").hex()


def _name(host: str) -> str:
    """The name in a `Host` header, without port and brackets."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:
        return ""
