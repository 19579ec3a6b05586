"""Who may ask the guide: whoever knows its token and comes from its own page.

On a machine that several people share, each of them can reach every port on loopback, and so can the pages of
other sites in one's browser. As in Jupyter, a random token in the address keeps both out.
"""

import json
import secrets
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from starlette.requests import ClientDisconnect, Request

MAX_BODY_BYTES = 4096
REDIRECTION = """<!doctype html>
<meta charset="utf-8"><meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0; url={url}">
<title>usbench guide</title>
<a href="{url}">The guide</a>
"""


class Refused(Exception):
    """A request that is not answered; `status` is that of HTTP, the message is a sentence."""

    def __init__(self, status: int, sentence: str) -> None:
        """Refuse with a status and a sentence."""
        super().__init__(sentence)
        self.status = status


def new_token() -> str:
    """Return a random token of 192 bits, 48 hexadecimal digits as Jupyter's."""
    return secrets.token_hex(24)


def check_sender(request: Request, token: str) -> None:
    """Refuse a request without the token, or from a page of another origin.

    A browser tells the origin with every POST. It must be the host that was asked: behind `ssh -L` that is
    another port than the server's own.

    Raises:
        Refused: With status 401 or 403.
    """
    origin = request.headers.get("origin")
    if origin is not None and origin != f"http://{request.headers.get('host')}":
        raise Refused(403, "a page of another origin may not use the guide.")
    scheme, _, given = request.headers.get("authorization", "").partition(" ")
    if scheme.lower() != "token" or not secrets.compare_digest(given.encode(), token.encode()):
        raise Refused(401, "the token is missing or wrong: open the address that the guide printed.")


async def body(request: Request) -> dict[str, Any]:
    """Return the JSON object that a request sends.

    Raises:
        Refused: If the body is of another type (415), longer than 4096 bytes (413), or no JSON object (400).
    """
    # Another site's page can send anything but this type without asking first.
    if request.headers.get("content-type") != "application/json":
        raise Refused(415, "the body must be application/json.")
    received = b""
    try:
        async for part in request.stream():
            received += part
            if len(received) > MAX_BODY_BYTES:
                raise Refused(413, f"the body must have at most {MAX_BODY_BYTES} bytes.")
    except ClientDisconnect:
        raise Refused(400, "the body is not whole: the sender went away.") from None
    try:
        read = json.loads(received)
    except (ValueError, RecursionError):  # no JSON, or lists within lists without end
        raise Refused(400, "the body must be a JSON object.") from None
    if not isinstance(read, dict):
        raise Refused(400, "the body must be a JSON object.")
    return read


def private_folder() -> TemporaryDirectory[str]:
    """Return a folder for `redirection` that goes at the end.

    It lies in the home folder and is not hidden: a browser in a sandbox, as Ubuntu's, reads nothing else.
    """
    try:
        return TemporaryDirectory(prefix="usbench-guide-", dir=Path.home())
    except (OSError, RuntimeError):  # there is none, or it cannot be written
        return TemporaryDirectory(prefix="usbench-guide-")


def redirection(folder: Path, url: str) -> str:
    """Write a file that leads a browser to `url` into `folder`; return the file's address.

    All users of a machine can read a browser's command line, so that the token must not be in it: as Jupyter
    does, the browser opens a file in a folder that only this user can enter.
    """
    path = folder / "guide.html"
    path.write_text(REDIRECTION.format(url=url), encoding="utf-8")
    return path.as_uri()
