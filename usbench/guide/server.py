"""The page of a guide on loopback: Starlette's routes to a `Desk`, nothing else.

A GET changes nothing; whatever changes the session is a POST. This module loads neither PyTorch nor the
simulator, so that the address is printed at once.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import sys
import webbrowser
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from usbench.checks import ConfigurationError, as_configuration_error, install, whole_number
from usbench.guide.desk import ELSEWHERE, Desk, Tell, Work

try:
    import uvicorn
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.middleware.trustedhost import TrustedHostMiddleware
    from starlette.requests import Request
    from starlette.responses import JSONResponse, Response
    from starlette.routing import Mount, Route
    from starlette.staticfiles import StaticFiles

    from usbench.guide.access import Refused, body, check_sender, new_token, private_folder, redirection
except ImportError:
    raise ConfigurationError(f"a guide needs Starlette and uvicorn: {install('guide')}.") from None

if TYPE_CHECKING:
    from usbench.guide.session import Session

HOST = "127.0.0.1"
PAGE = Path(__file__).with_name("page")
PATIENCE = 0.3  # s that an answer waits for work; the page hears of work that takes longer
# Only what comes from here is loaded, and no other page may hold this one in a frame.
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; form-action 'none'",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


def application(desk: Desk, token: str) -> Starlette:
    """Return the web application of `desk`; all but the page's files is for who has the token."""
    answers = _Answers(desk, token)
    routes = [
        Route("/state", answers.state),
        Route("/update", answers.update, methods=["POST"]),
        answers.button("act", "action"),
        answers.button("follow"),
        answers.button("begin"),
        answers.button("train"),
        answers.button("choose", "task", "noise", "agent", "hidden", optional=True),
        Mount("/", _Files(directory=PAGE, html=True)),
    ]
    return Starlette(
        routes=routes,
        # Another site's name may be made to lead to loopback.
        middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=[HOST, "localhost"])],
        exception_handlers={Refused: _refusal},
    )


class _Answers:
    """What is answered to who has the token: the state of a desk, after what was asked for is done."""

    def __init__(self, desk: Desk, token: str) -> None:
        self._desk, self._token = desk, token

    async def state(self, request: Request) -> Response:
        """The state as it is."""
        check_sender(request, self._token)
        return _answer(self._desk.state())

    async def update(self, request: Request) -> Response:
        """The state after a look at what has changed by itself."""
        check_sender(request, self._token)
        await body(request)
        if self._desk.busy:
            return _answer(self._desk.state())
        return await self._done(lambda session: session.update())

    def button(self, name: str, *keys: str, optional: bool = False) -> Route:
        """The route to the session's method `name`, called with all, or any, of the `keys` in the body."""

        async def pressed(request: Request) -> Response:
            check_sender(request, self._token)
            values = await body(request)
            place = values.pop("place", None)
            if not values.keys() <= set(keys) or not (optional or values.keys() == set(keys)):
                raise Refused(
                    400, f"the body must be an object with the keys {list(keys)}, not {list(values)}."
                )
            state = self._desk.state()
            if state["busy"]:
                return _answer({"error": f"The guide is busy: {state['busy']}.", "state": state}, 409)
            # On a page that is out of date, nobody has seen what the button would act on.
            if place != state["place"]:
                return _answer({"error": ELSEWHERE, "state": state}, 409)
            return await self._done(lambda session: getattr(session, name)(**values))

        return Route(f"/{name}", pressed, methods=["POST"])

    async def _done(self, work: Work) -> Response:
        """Let `work` be done and answer with the new state; with the old one and `busy` if it takes long."""
        job = asyncio.wrap_future(self._desk.do(work))
        # What fails later stands in the state: here it is only taken notice of.
        job.add_done_callback(lambda ended: ended.cancelled() or ended.exception())
        await asyncio.wait([job], timeout=PATIENCE)
        error = job.exception() if job.done() else None
        if isinstance(error, ValueError | TypeError | OverflowError):
            raise Refused(400, str(error)) from error
        if error is not None:
            return _answer({"error": f"{type(error).__name__}: {error}"}, 500)
        return _answer(self._desk.state())


@contextlib.contextmanager
def listening(port: Any = 0) -> Iterator[socket.socket]:
    """Listen on loopback, on a free port if `port` is 0.

    Raises:
        ConfigurationError: If `port` is no port, or taken.
    """
    with as_configuration_error():
        number = whole_number("port", port, 0, 65535)
    try:
        listener = socket.create_server((HOST, number))
    except OSError as error:
        raise ConfigurationError(
            f"port {number} cannot be used ({error.strerror}): choose another, or 0 for a free one."
        ) from error
    with listener:
        yield listener


def address(listener: socket.socket, token: str) -> str:
    """Return where the page is, with the token that it needs."""
    return f"http://{HOST}:{listener.getsockname()[1]}/?token={token}"


def serve(make: Callable[[Tell], Session], listener: socket.socket, *, browser: bool) -> None:
    """Serve the page until Ctrl-C, which is raised then; open it in a browser if asked to and possible.

    The address is printed at once; `make` makes the session meanwhile, as `Desk.start` takes it.

    Raises:
        Exception: That of `make`.
    """
    token, desk = new_token(), Desk()
    url, running = address(listener, token), server(desk, token)
    print(f"The guide is at {url} (Ctrl-C ends it).", flush=True)
    # Without a screen, Python would start a browser in this terminal.
    on_screen = sys.platform != "linux" or bool({"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys())
    with contextlib.ExitStack() as held:
        held.callback(desk.close)
        desk.start(make, failed=lambda: setattr(running, "should_exit", True))
        if browser and on_screen:
            folder = held.enter_context(private_folder())
            webbrowser.open(redirection(Path(folder), url))
        running.run(sockets=[listener])
    if desk.failure is not None:
        raise desk.failure


def server(desk: Desk, token: str) -> uvicorn.Server:
    """Return a server for `desk`; `run(sockets=[listener])` serves until it is interrupted."""
    config = uvicorn.Config(application(desk, token), log_level="warning", lifespan="off")
    config.timeout_graceful_shutdown = 0.5  # type: ignore[assignment]  # seconds; uvicorn takes a float too
    return uvicorn.Server(config)


class _Files(StaticFiles):
    """The page's files, with the headers that all answers have."""

    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        response = super().file_response(*args, **kwargs)
        response.headers.update(HEADERS)
        return response


def _answer(values: Mapping[str, Any], status: int = 200) -> Response:
    return JSONResponse(values, status, HEADERS)


async def _refusal(_: Request, refused: Exception) -> Response:
    status = refused.status if isinstance(refused, Refused) else 500
    return _answer({"error": str(refused)}, status)
