"""The workbench in the browser: second tabs, cancelled solves, wrong tokens, servers that end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mapmeld.studio.server import NOT_HERE
from rooms import building, save
from studio_page import Page, browser, placed, require_browser, studio


@pytest.fixture(autouse=True)
def _browser() -> None:
    require_browser()


def test_a_second_tab_asks_and_takes_over(bench: tuple[Any, str]) -> None:
    context, url = bench
    first = Page(context, url)
    first.until_solved()
    second = Page(context, url)
    second.until("document.getElementById('elsewhere').open")
    assert not first.locator("#elsewhere").evaluate("d => d.open")
    second.click("#use-here")
    first.until("document.getElementById('elsewhere').open")
    second.select("left")
    second.click("#pin")
    second.until("app.state.maps[0].pin === 'hard'")
    # Whoever asks behind the dialog's back is told.
    first.evaluate("app.act('undo')")
    first.until("document.getElementById('message').innerText.includes('another tab')")
    second.close()
    first.click("#use-here")
    first.click("#undo")
    first.until("app.state.maps[0].pin === null")


def test_a_closed_tab_during_a_solve_loses_nothing(bench: tuple[Any, str]) -> None:
    context, url = bench
    page = context.new_page()
    page.goto(url)
    page.wait_for_selector("body[data-ready]")
    page.close()
    back = Page(context, url)
    back.until_solved()
    assert placed(back)["left"] == "merged"


def test_a_solve_can_be_cancelled(shared_data: Path, tmp_path: Path) -> None:
    # The case whose solve takes longest.
    maps = sorted((shared_data / "halmstad_E5_half").glob("*.yaml"))
    with studio(maps, tmp_path / "out") as url, browser() as context:
        page = Page(context, url)
        page.until("app.state.solving && app.state.solving.total > 0")
        page.click("#cancel")
        page.until("document.querySelector('#message').textContent.includes('cancelled')", 30)
        page.until("!app.state.solving", 30)
        assert not page.evaluate("app.state.is_solved")


def test_a_wrong_token_is_told(bench: tuple[Any, str]) -> None:
    context, url = bench
    page = context.new_page()
    root, token = url.rstrip("/").rsplit("/", 1)
    for wrong in (f"{root}/{token[::-1]}/", f"{root}/", f"{root}/x/state"):
        reply = page.goto(wrong)
        assert reply.status == 403
        assert "right token" in page.inner_text("body")
    # With the right token it is not the token that is wrong.
    for there in (f"{url}nothing", f"{url}map/99.png"):
        reply = context.request.get(there)
        assert reply.status == 404
        assert "right token" not in reply.text()
        assert reply.text().strip() in (NOT_HERE, "there is no map 99")
    reply = context.request.post(f"{root}/x/act", data={"tab": "t", "do": "save"})
    assert reply.status == 403
    elsewhere = context.request.get(f"{url}state", headers={"Host": "evil.example"})
    assert elsewhere.status == 400


def test_the_server_that_ends_is_told(tmp_path: Path) -> None:
    maps = save(tmp_path / "maps", building())
    with browser() as context:
        with studio(maps, tmp_path / "out") as url:
            page = Page(context, url)
            page.until_solved()
        page.until("!document.getElementById('gone').hidden", 10)
        assert "start it again" in page.text("#gone").replace("\n", " ")


def test_an_answer_that_news_overtook_is_not_believed(bench: tuple[Any, str]) -> None:
    page = Page(*bench)
    page.until_solved()
    old = page.evaluate("fetch('state').then(r => r.json())")
    page.select("left")
    page.click("#pin")
    page.until("app.state.maps[0].pin === 'hard'")
    page.evaluate("state => app.hear(state)", old)
    assert page.evaluate("app.state.maps[0].pin") == "hard"
