"""The workbench over HTTP: the page, the maps' pictures, what is asked, and news as server-sent events.

Everything lies below a random token, so that no other page and no other user of the machine can ask.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import io
import json
import threading
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from mapmeld import _core
from mapmeld.errors import MapmeldError
from mapmeld.grid import OccupancyGrid
from mapmeld.palette import map_colour
from mapmeld.studio.pinning import SOFT_SIGMA
from mapmeld.studio.saving import Busy
from mapmeld.studio.workbench import Workbench

PAGE = Path(__file__).parent / "page"
WRONG_TOKEN = (
    "This address lacks the right token. Copy the whole address that `mapmeld studio` printed; each start "
    "has a token of its own."
)
NOT_HERE = (
    "There is nothing at this address. The workbench's page is the address that `mapmeld studio` printed."
)
END = "end"
"""The news that ends a tab's stream of news."""
_MOST_BYTES = 1 << 20
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; frame-ancestors 'none'; base-uri 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


@dataclass
class Tabs:
    """The browser tabs that listen. One of them holds the bench: two that move maps at once would undo each
    other's work."""

    news: dict[str, asyncio.Queue[str]] = field(default_factory=dict)
    holder: str | None = None

    def tell(self, event: str, only: str | None = None) -> None:
        """Puts news before the tabs; "state" waits there only once."""
        for tab, queue in self.news.items():
            if only in (None, tab) and not (event == "state" and "state" in _waiting(queue)):
                queue.put_nowait(event)

    def take(self, tab: str) -> None:
        """The tab holds the bench from now on."""
        old, self.holder = self.holder, tab
        if old is not None and old != tab:
            self.tell("taken", only=old)

    def is_free_for(self, tab: str) -> bool:
        """Whether nobody else who is still there holds the bench."""
        return self.holder in (None, tab) or self.holder not in self.news


def application(bench: Workbench, token: str) -> Starlette:
    """The server's application; its address is /<token>/."""
    tabs = Tabs()
    index = list(bench.grids)

    async def page(request: Request) -> Response:
        return Response((PAGE / "index.html").read_bytes(), media_type="text/html")

    async def maps(request: Request) -> Response:
        return JSONResponse(
            {
                "version": _core.__version__,
                "maps": [
                    {
                        "name": n,
                        "width": g.width,
                        "height": g.height,
                        "resolution": g.resolution,
                        "origin": list(g.origin),
                        "box": list(bench.boxes[n]),
                        "colour": [round(255 * c) for c in map_colour(k)],
                    }
                    for k, (n, g) in enumerate(bench.grids.items())
                ],
            }
        )

    async def picture(request: Request) -> Response:
        k = request.path_params["index"]
        if not 0 <= k < len(index):
            raise HTTPException(404, f"there is no map {k}")
        png = await run_in_threadpool(classes_png, bench.grids[index[k]])
        return Response(png, media_type="image/png")

    async def pairs(request: Request) -> Response:
        try:
            return JSONResponse(bench.pairs(request.query_params.get("map", "")))
        except MapmeldError as error:
            raise HTTPException(400, str(error)) from None

    async def conflicts(request: Request) -> Response:
        try:
            layer = bench.conflicts(request.path_params["component"])
        except MapmeldError as error:
            raise HTTPException(400, str(error)) from None
        return Response(await run_in_threadpool(conflicts_png, layer), media_type="image/png")

    async def state(request: Request) -> Response:
        return JSONResponse(bench.state())

    async def events(request: Request) -> Response:
        tab = request.query_params.get("tab", "")
        if not tab or len(tab) > 64:
            raise HTTPException(400, "tab: must be the name of a browser tab")
        loop = asyncio.get_running_loop()
        bench.changed = lambda: loop.call_soon_threadsafe(tabs.tell, "state")
        if tabs.is_free_for(tab):
            tabs.take(tab)
        queue: asyncio.Queue[str] = asyncio.Queue()
        tabs.news[tab] = queue
        queue.put_nowait("state" if tabs.holder == tab else "elsewhere")

        async def stream() -> AsyncIterator[str]:
            try:
                while True:
                    # A line now and then finds out whether the tab is still there.
                    with contextlib.suppress(asyncio.TimeoutError):
                        event = await asyncio.wait_for(queue.get(), 5.0)
                        if event == END:
                            return
                        data = json.dumps(bench.state()) if event == "state" else "{}"
                        yield f"event: {event}\ndata: {data}\n\n"
                        continue
                    yield ": still here\n\n"
            finally:
                if tabs.news.get(tab) is queue:
                    del tabs.news[tab]

        return StreamingResponse(stream(), media_type="text/event-stream")

    async def take(request: Request) -> Response:
        tab = str((await _body(request)).get("tab", ""))
        tabs.take(tab)
        return JSONResponse(bench.state())

    async def act(request: Request) -> Response:
        """One action of the page: {"tab", "do", ...}."""
        body = await _body(request)
        tab, name = str(body.get("tab", "")), body.get("do")
        if not tabs.is_free_for(tab):
            message = "this bench is in use in another tab; press “Use it here” to go on in this one"
            return JSONResponse({"error": message, "elsewhere": True}, 409)
        action = ACTIONS.get(name) if isinstance(name, str) else None
        if action is None:
            return JSONResponse({"error": f"do: there is no action {name!r}"}, 400)
        tabs.holder = tab
        if name == "solve":
            if bench.state()["solving"] is not None:
                return JSONResponse({"error": "a solve is running; wait for it or cancel it"}, 409)
            # Whoever closes the tab meanwhile finds the answer when the page is opened again.
            threading.Thread(target=bench.solve, daemon=True).start()
            return JSONResponse({"told": None, "state": bench.state()})
        try:
            told = await run_in_threadpool(action, bench, body)
        except Busy as error:
            return JSONResponse({"error": str(error), "state": bench.state()}, 409)
        except MapmeldError as error:
            return JSONResponse({"error": str(error), "state": bench.state()}, 400)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            return JSONResponse({"error": f"{name}: the request is not complete: {error!r}"}, 400)
        return JSONResponse({"told": told, "state": bench.state()})

    def wrong(request: Request, error: Exception) -> Response:
        code = error.status_code if isinstance(error, HTTPException) else 500
        text = getattr(error, "detail", str(error))
        # Whoever comes here has the right token; starlette's own words for it say nothing.
        if text == "Not Found":
            text = NOT_HERE
        return PlainTextResponse(text + "\n", code, _HEADERS)

    inside = [
        Route("/", page),
        Route("/maps", maps),
        Route("/map/{index:int}.png", picture),
        Route("/conflicts/{component:int}.png", conflicts),
        Route("/pairs", pairs),
        Route("/state", state),
        Route("/events", events),
        Route("/take", take, methods=["POST"]),
        Route("/act", act, methods=["POST"]),
        Mount("/page", StaticFiles(directory=PAGE)),
    ]

    def guarded(app: Any) -> Any:
        async def guard(scope: Any, receive: Any, send: Any) -> None:
            if scope["type"] == "http":
                given = scope["path"].split("/")[1]
                if not hmac.compare_digest(given.encode(), token.encode()):
                    await PlainTextResponse(WRONG_TOKEN + "\n", 403, _HEADERS)(scope, receive, send)
                    return

            async def with_headers(message: Any) -> None:
                if message["type"] == "http.response.start":
                    extra = [(k.lower().encode(), v.encode()) for k, v in _HEADERS.items()]
                    message = {**message, "headers": [*message["headers"], *extra]}
                await send(message)

            await app(scope, receive, with_headers)

        return guard

    served = Starlette(
        routes=[Mount(f"/{token}", routes=inside)],
        middleware=[
            # A page elsewhere whose name was made to point here does not get in.
            Middleware(TrustedHostMiddleware, allowed_hosts=["127.0.0.1", "localhost"]),
            Middleware(guarded),
        ],
        exception_handlers={HTTPException: wrong},
    )
    served.state.tabs = tabs
    return served


def classes_png(grid: OccupancyGrid) -> bytes:
    """A map as a grey picture: 0 unknown, 128 free, 255 occupied, row 0 at the top and of the highest y."""
    from PIL import Image

    levels = np.zeros(grid.data.shape, dtype=np.uint8)
    levels[grid.data >= 0] = 128
    levels[grid.data >= 50] = 255
    file = io.BytesIO()
    Image.fromarray(levels[::-1]).save(file, "PNG", compress_level=1)
    return file.getvalue()


def conflicts_png(layer: NDArray[np.bool_]) -> bytes:
    """Where maps contradict each other as a red picture that shows what lies below; row 0 at the top, of the
    highest y."""
    from PIL import Image

    alpha = np.where(layer[::-1], 170, 0).astype(np.uint8)
    picture = Image.new("RGBA", alpha.shape[::-1], (226, 0, 26, 0))
    picture.putalpha(Image.fromarray(alpha))
    file = io.BytesIO()
    picture.save(file, "PNG", compress_level=1)
    return file.getvalue()


async def _body(request: Request) -> dict[str, Any]:
    raw = b""
    async for chunk in request.stream():
        raw += chunk
        if len(raw) > _MOST_BYTES:
            raise HTTPException(413, "the request is too large")
    try:
        value = json.loads(raw)
    except ValueError:
        value = None
    if not isinstance(value, dict):
        raise HTTPException(400, "the request must be a JSON object")
    return value


def _waiting(queue: asyncio.Queue[str]) -> list[str]:
    return list(queue._queue)  # type: ignore[attr-defined]


def _point(value: Any) -> tuple[float, float]:
    x, y = value
    return float(x), float(y)


ACTIONS: dict[str, Callable[[Workbench, dict[str, Any]], Any]] = {
    "move": lambda b, q: b.move(q["poses"]),
    "snap": lambda b, q: b.snap([str(n) for n in q["names"]]),
    "pin": lambda b, q: b.pin(str(q["name"]), SOFT_SIGMA if q.get("soft") else None),
    "unpin": lambda b, q: b.unpin(str(q["name"])),
    "forbid": lambda b, q: b.forbid(str(q["a"]), str(q["b"])),
    "allow": lambda b, q: b.allow(str(q["a"]), str(q["b"])),
    "points": lambda b, q: b.same_points(
        str(q["a"]), str(q["b"]), [(_point(p), _point(r)) for p, r in q["points"]]
    ),
    "forget_points": lambda b, q: b.forget_points(str(q["a"]), str(q["b"])),
    "choose": lambda b, q: b.choose(int(q["hypothesis"])),
    "undo": lambda b, q: b.undo(),
    "redo": lambda b, q: b.redo(),
    "solve": lambda b, q: b.solve(),
    "cancel": lambda b, q: b.cancel(),
    "save": lambda b, q: b.save(),
}
"""What the page may ask for: `do`, and what comes with it."""
