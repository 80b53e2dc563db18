"""A viser server for one person, and the thread that computes what its page wants last.

This machine alone, a token, and messages that are checked.

viser takes whatever a page sends. Here every request passes first: its Host, its Origin, the token
of the link (kept in a cookie, since the page opens its socket without the link), the size and the
kind of each message, and the value that it sets.
"""

__all__ = ["serve"]

import functools
import hmac
import http
import logging
import math
import secrets
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from http.cookies import CookieError, SimpleCookie
from typing import Any
from unittest.mock import patch
from urllib.parse import parse_qsl, urlsplit

from kneejax.numerics import imported

HOST = "127.0.0.1"
#: Bytes of a message; a picture that the page renders is the largest.
_MOST = 8 * 1024 * 1024
_LONGEST_WORD = 200
#: Kinds of messages that have a meaning here. Among those without: a public tunnel, uploads.
_KNOWN = {
    "ViewerCameraMessage", "GuiUpdateMessage", "SceneNodeClickMessage",
    "TransformControlsUpdateMessage", "TransformControlsDragStartMessage",
    "TransformControlsDragEndMessage", "GetRenderResponseMessage", "FileTransferPartAck",
}  # fmt: skip


def serve(port: int, opened: Callable[[str], Any]) -> tuple[Any, str]:
    """Start a server on this machine.

    Args:
        port: the first to try; the next free one is taken.
        opened: called with the query of every link that is opened, without its token.

    Returns:
        The `viser.ViserServer`, and the link to its page.

    Raises:
        MissingPackage: viser is not installed.
    """
    viser = imported("viser", "viser", "explore")
    from websockets.asyncio import server as sockets

    token, made = secrets.token_urlsafe(24), []
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)

    class Checked(sockets.ServerConnection):
        """A connection that passes only messages that mean something."""

        async def recv(self, *how: Any, **more: Any) -> Any:
            while True:
                raw = await super().recv(*how, **more)
                if isinstance(raw, bytes) and made and _means_something(made[0], raw):
                    return raw

    def guarded(handler: Any, *where: Any, process_request: Any, **how: Any) -> Any:
        answered = functools.partial(_answered, process_request, token, opened)
        how |= {"max_size": _MOST, "create_connection": Checked}
        return usual(handler, *where, process_request=answered, **how)

    usual = sockets.serve
    # viser has no place for this: the server's own call is wrapped while it starts.
    with patch.object(sockets, "serve", guarded), patch("rich.print"):
        made.append(viser.ViserServer(host=HOST, port=port, verbose=False))
    return made[0], f"http://{HOST}:{made[0].get_port()}/?token={token}"


def _answered(
    usual: Any, token: str, opened: Callable[[str], Any], connection: Any, request: Any
) -> Any:
    """The answer to a request; None where a socket may open."""
    port = connection.local_address[1]
    hosts = {f"{HOST}:{port}", f"localhost:{port}"}
    host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
    if host not in hosts or (origin is not None and origin != f"http://{host}"):
        return connection.respond(http.HTTPStatus.FORBIDDEN, "another site may not ask this\n")
    is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
    name, query = f"kneejax-{port}", dict(parse_qsl(urlsplit(request.path).query))
    given = "" if is_socket else query.pop("token", "")
    try:
        cookies = SimpleCookie(request.headers.get("Cookie", ""))
        kept = cookies[name].value if name in cookies else ""
    except CookieError:
        kept = ""
    if not any(hmac.compare_digest(x.encode(), token.encode()) for x in (given, kept)):
        words = "open the whole link that kneejax explore has printed\n"
        return connection.respond(http.HTTPStatus.FORBIDDEN, words)
    if is_socket:
        return usual(connection, request) if origin is not None else connection.respond(
            http.HTTPStatus.FORBIDDEN, "a socket without an origin\n")  # fmt: skip
    if query and urlsplit(request.path).path == "/":
        opened("&".join(f"{k}={x}" for k, x in query.items()))
    response = usual(connection, request)
    cookie = f"{name}={token}; HttpOnly; SameSite=Strict; Path=/"
    response.headers["Set-Cookie"] = cookie
    response.headers["Referrer-Policy"] = "no-referrer"
    response.headers["X-Frame-Options"] = "DENY"
    return response


def _means_something(server: Any, raw: bytes) -> bool:
    """Whether a message can be read, is of a known kind, and sets a value that may be set."""
    from viser._messages import Message

    try:
        message = Message.deserialize(raw)
        kind = type(message).__name__
        if kind not in _KNOWN:
            return False
        if kind == "GuiUpdateMessage":
            return _may_be_set(server, message)
        return _finite(vars(message))
    except Exception:  # whatever a message is, it has no effect
        return False


def _may_be_set(server: Any, message: Any) -> bool:
    handle = server.gui._gui_input_handle_from_uuid.get(message.uuid)
    if handle is None or set(message.updates) != {"value"}:
        return False
    value, own = message.updates["value"], handle._impl.value
    if isinstance(own, bool):
        return isinstance(value, bool)
    if isinstance(own, int | float):
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        low, high = getattr(handle, "min", -math.inf), getattr(handle, "max", math.inf)
        return is_number and low - 1e-9 <= value <= high + 1e-9
    if isinstance(own, str):
        options = getattr(handle, "options", (value,))
        return isinstance(value, str) and len(value) <= _LONGEST_WORD and value in options
    return False


def _finite(value: Any) -> bool:
    if isinstance(value, dict):
        return all(map(_finite, value.values()))
    if isinstance(value, list | tuple):
        return all(map(_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


class Superseded(Exception):
    """Something else is wanted by now."""


class Latest:
    """Whatever is wanted next ends what is computed, at its next chance."""

    def __init__(self, compute: Callable[[], None], failed: Callable[[], None]):
        """Compute in a thread what is wanted; `failed` is called after what the terminal shows."""
        self.lock, self.settled = threading.Condition(), threading.Event()
        self._compute, self._failed = compute, failed
        self._wanted = self._begun = 0
        self._ended = False
        self.aside = ThreadPoolExecutor(1)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def want(self) -> None:
        """Have it computed again; whoever calls holds the lock."""
        self._wanted += 1
        self.settled.clear()
        self.lock.notify()

    def end(self) -> None:
        """End the threads."""
        with self.lock:
            self._ended = True
            self.lock.notify()
        self._thread.join()
        self.aside.shutdown()

    def go_on(self, *_: int) -> None:
        """Raise `Superseded` where that is so."""
        if self._superseded():
            raise Superseded

    def rest(self, seconds: float) -> None:
        """Wait; what is wanted earlier ends it."""
        with self.lock:
            self.lock.wait_for(self._superseded, seconds)
        self.go_on()

    def meanwhile(self, work: Callable[..., Any], *given: Any) -> Any:
        """Compute something that calls `progress` now and then; what is wanted ends it."""
        begun = self._begun

        def go_on(*_: int) -> None:
            # The thread may have begun anew by then.
            if self._ended or begun != self._wanted:
                raise Superseded

        def done(_: Any) -> None:
            with self.lock:
                self.lock.notify()

        future = self.aside.submit(work, *given, progress=go_on)
        future.add_done_callback(done)
        with self.lock:
            self.lock.wait_for(lambda: future.done() or self._superseded())
        future.cancel()
        self.go_on()
        return future.result()

    def _superseded(self) -> bool:
        return self._ended or self._begun != self._wanted

    def _run(self) -> None:
        while True:
            with self.lock:
                self.lock.wait_for(self._superseded)
                if self._ended:
                    return
                self._begun = self._wanted
            try:
                self._compute()
            except Superseded:
                continue
            except Exception:  # the page lives on, the terminal says why
                traceback.print_exc()
                self._failed()
            with self.lock:
                if not self._superseded():
                    self.settled.set()
