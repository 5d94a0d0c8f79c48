"""The workbench's page in a real browser: Debian's chromium, driven by Playwright."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = os.environ.get("MAPMELD_CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")


def require_browser() -> None:
    """Skips, loudly, where no browser can be driven."""
    pytest.importorskip("playwright.sync_api", reason="NO BROWSER TEST: playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("NO BROWSER TEST: no chromium found; apt install chromium, or set MAPMELD_CHROMIUM")


@contextlib.contextmanager
def studio(maps: Sequence[str | Path], output: Path, *args: str) -> Iterator[str]:
    """`mapmeld studio` on these maps; its address."""
    command = [
        sys.executable,
        "-m",
        "mapmeld",
        "studio",
        *map(str, maps),
        "-o",
        str(output),
        "--no-browser",
        *args,
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert process.stdout is not None
        seen = ""
        for line in process.stdout:
            seen += line
            if found := re.search(r"http://\S+", line):
                yield found[0]
                break
        else:
            raise AssertionError(f"no address: {seen}")
    finally:
        process.send_signal(signal.SIGINT)
        try:
            code = process.wait(timeout=20)
        finally:
            process.kill()
    assert code == 0, "Ctrl-C must end it well"


@contextlib.contextmanager
def browser(**context: Any) -> Iterator[Any]:
    """A browser context of a headless chromium."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        try:
            yield chromium.new_context(viewport={"width": 1280, "height": 800}, **context)
        finally:
            chromium.close()


class Page:
    """One tab with the workbench's page, and what a person does there."""

    def __init__(self, context: Any, url: str) -> None:
        self.tab = context.new_page()
        self.errors: list[str] = []
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.goto(url)
        self.tab.wait_for_selector("body[data-ready]")

    def __getattr__(self, name: str) -> Any:
        return getattr(self.tab, name)

    def until(self, condition: str, seconds: float = 60.0) -> None:
        """Waits for a condition of the page's; its policy forbids what Playwright has for that."""
        end = time.monotonic() + seconds
        while not self.tab.evaluate(condition):
            assert time.monotonic() < end, f"{condition} never came; {self.errors} {self.text('#message')}"
            time.sleep(0.05)

    def until_solved(self) -> None:
        self.until("app.state.is_current && !app.state.solving")

    def until_says(self, selector: str, text: str) -> None:
        """Waits for a text: the page tells some time after it knows."""
        script = f"document.querySelector({json.dumps(selector)}).innerText.includes({json.dumps(text)})"
        self.until(script, 20.0)

    def text(self, selector: str) -> str:
        return str(self.tab.inner_text(selector))

    def screen(self, name: str, point: Sequence[float]) -> tuple[float, float]:
        """Where a point of a map, map coordinates, is on the screen."""
        script = """([name, [x, y]]) => {
            const [tx, ty, t] = app.poses[name], c = Math.cos(t), s = Math.sin(t);
            const box = document.getElementById('bench').getBoundingClientRect();
            const [u, v] = app.scene.toScreen([tx + c * x - s * y, ty + s * x + c * y]);
            return [u + box.left, v + box.top];
        }"""
        u, v = self.tab.evaluate(script, [name, list(map(float, point))])
        return u, v

    def pose(self, name: str) -> list[float]:
        """Where the workbench, not the page, has a map."""
        script = (
            "name => fetch('state').then(r => r.json()).then(s => s.maps.find(m => m.name === name).pose)"
        )
        return list(self.tab.evaluate(script, name))

    def select(self, name: str) -> None:
        self.tab.locator("#maps button", has_text=name).first.click()

    def drag(self, start: Sequence[float], end: Sequence[float]) -> None:
        self.tab.mouse.move(*start)
        self.tab.mouse.down()
        for k in (0.3, 0.7, 1.0):
            self.tab.mouse.move(*(s + k * (e - s) for s, e in zip(start, end, strict=True)))
        self.tab.mouse.up()


def placed(page: Page) -> dict[str, str]:
    return {m["name"]: m["status"] for m in page.evaluate("app.state.maps")}
