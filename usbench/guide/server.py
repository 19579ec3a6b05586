"""The page of a guide on loopback: Starlette's routes to a `Session`, nothing else.

A GET changes nothing; whatever changes the session is a POST.
"""

import contextlib
import json
import os
import socket
import sys
import webbrowser
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import torch

from usbench.checks import whole_number
from usbench.guide.session import Session
from usbench.records import ConfigurationError

try:
    import uvicorn
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.middleware.trustedhost import TrustedHostMiddleware
    from starlette.requests import Request
    from starlette.responses import JSONResponse, Response
    from starlette.routing import Mount, Route
    from starlette.staticfiles import StaticFiles
except ImportError:
    raise ConfigurationError("a guide needs Starlette and uvicorn: pip install 'usbench[guide]'.") from None

HOST = "127.0.0.1"
PAGE = Path(__file__).with_name("page")
# Only what comes from here is loaded, and no other page may hold this one in a frame.
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; form-action 'none'",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
}


def application(session: Session) -> Starlette:
    """Return the web application of `session`."""

    def button(work: Callable[..., None], *names: str) -> Callable[[Request], Awaitable[Response]]:
        async def pressed(request: Request) -> Response:
            # Another site's page can send anything but this type without asking first.
            if request.headers.get("content-type") != "application/json":
                return _refusal("the body must be application/json.", 415)
            try:
                body = json.loads(await request.body())
                if not isinstance(body, dict) or not body.keys() <= set(names):
                    raise ValueError(f"the body must be an object with no other keys than {list(names)}.")
                work(**body)
            except (ValueError, TypeError) as error:
                return _refusal(str(error), 400)
            return _answer(session)

        return pressed

    async def state(_: Request) -> Response:
        return _answer(session)

    routes = [
        Route("/state", state),
        Route("/act", button(session.act, "action"), methods=["POST"]),
        Route("/follow", button(session.follow), methods=["POST"]),
        Route("/begin", button(session.begin), methods=["POST"]),
        Route("/train", button(session.train), methods=["POST"]),
        Route("/update", button(session.update), methods=["POST"]),
        Route("/choose", button(session.choose, "task", "noise", "agent", "hidden"), methods=["POST"]),
        Mount("/", _Files(directory=PAGE, html=True)),
    ]
    # Another site's name may be made to lead to loopback.
    return Starlette(routes=routes, middleware=[Middleware(TrustedHostMiddleware, [HOST, "localhost"])])


@contextlib.contextmanager
def listening(port: Any = 0) -> Iterator[socket.socket]:
    """Listen on loopback, on a free port if `port` is 0.

    Raises:
        ConfigurationError: If `port` is no port, or taken.
    """
    try:
        number = whole_number("port", port, 0, 65535)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(str(error)) from error
    try:
        listener = socket.create_server((HOST, number))
    except OSError as error:
        raise ConfigurationError(
            f"port {number} cannot be used ({error.strerror}): choose another, or 0 for a free one."
        ) from error
    with listener:
        yield listener


def address(listener: socket.socket) -> str:
    """Return where the page is."""
    return f"http://{HOST}:{listener.getsockname()[1]}/"


def serve(session: Session, listener: socket.socket, *, browser: bool) -> None:
    """Serve the page until Ctrl-C, which is raised then; open it in a browser if asked to and possible."""
    print(f"The guide is at {address(listener)} (Ctrl-C ends it).", flush=True)
    # Without a screen, Python would start a browser in this terminal.
    on_screen = sys.platform != "linux" or bool({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys())
    if browser and on_screen:
        webbrowser.open(address(listener))
    torch.set_num_threads(1)  # as fast for one frame, and waits for nobody where other cores are busy
    try:
        server(session).run(sockets=[listener])
    finally:
        session.close()


def server(session: Session) -> uvicorn.Server:
    """Return a server for `session`; `run(sockets=[listener])` serves until it is interrupted."""
    config = uvicorn.Config(
        application(session), log_level="warning", lifespan="off", timeout_graceful_shutdown=1
    )
    return uvicorn.Server(config)


class _Files(StaticFiles):
    """The page's files, with the headers that all answers have."""

    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        response = super().file_response(*args, **kwargs)
        response.headers.update(HEADERS)
        return response


def _answer(session: Session) -> Response:
    return JSONResponse(session.state(), headers=HEADERS)


def _refusal(sentence: str, status: int) -> Response:
    return JSONResponse({"error": sentence}, status_code=status, headers=HEADERS)
