"""Runs the workbench's server until it is interrupted."""

from __future__ import annotations

import secrets
import socket
import sys
from collections.abc import Callable

import uvicorn

from mapmeld.errors import MapmeldError
from mapmeld.studio.server import END, application
from mapmeld.studio.workbench import Workbench

HOST = "127.0.0.1"


def bound(port: int) -> socket.socket:
    """A socket of this machine alone at the port; 0: any that is free. Raises MapmeldError: it is taken."""
    place = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if sys.platform != "win32":
        # A port whose last connections are fading is free; one that somebody listens at is not.
        place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        place.bind((HOST, port))
        place.listen(64)
    except (OSError, OverflowError) as error:
        place.close()
        reason = getattr(error, "strerror", None) or str(error)
        raise MapmeldError(
            f"--port {port}: cannot be used: {reason}; choose another one, or leave --port out for a free one"
        ) from error
    return place


class _Server(uvicorn.Server):
    """A server that tells the tabs when it ends, which would keep it waiting otherwise."""

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self.config.app.state.tabs.tell(END)  # type: ignore[union-attr]
        await super().shutdown(sockets)


def serve(bench: Workbench, place: socket.socket, ready: Callable[[str], object]) -> None:
    """Serves until Ctrl-C. ready: is told the address, with its token, before the first request comes."""
    token = secrets.token_urlsafe(24)
    config = uvicorn.Config(
        application(bench, token),
        log_level="warning",
        access_log=False,
        lifespan="off",
        timeout_graceful_shutdown=1,
    )
    try:
        ready(f"http://{HOST}:{place.getsockname()[1]}/{token}/")
        _Server(config).run(sockets=[place])
    except KeyboardInterrupt:
        # How it is ended; uvicorn raises it again when it has shut down.
        pass
    finally:
        bench.cancel()
        place.close()
