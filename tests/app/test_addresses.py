"""What a browser gets that is given an address by hand."""

import re

import pytest

from tests.app.browser import Page
from tests.app.conftest import Server


def test_the_name_of_a_page_leads_to_it(page: Page, server: Server) -> None:
    script = server.ask("GET", "/static/js/main.js").body.decode()
    pages = re.findall(r"^  (\w+): \[\"", script, re.MULTILINE)
    assert {"localize", "batch", "kept"} <= set(pages)
    for name in pages:
        reply = server.ask("GET", f"/{name}")
        assert (reply.status, reply.headers["location"]) == (307, f"/#/{name}")
    assert server.ask("GET", "/batch/0f").headers["location"] == "/#/batch/0f"
    page.driver.get(f"{page.address}batch")
    page.wait(lambda: page.has("Where do all the close-ups lie?"))
    assert page.driver.current_url.endswith("/#/batch")


@pytest.mark.parametrize("path", ["batches", "favicon.ico", "static/js/no.js"])
def test_an_unknown_address_is_a_plain_page(page: Page, path: str) -> None:
    page.driver.get(page.address + path)
    assert page.has("There is no such page")
    page.push("Go to the start page")
    page.wait(lambda: page.has("Where does the close-up lie?"))


def test_programs_get_no_page(server: Server) -> None:
    reply = server.ask("GET", "/api/nothing")
    assert (reply.status, reply.json()) == (404, {"detail": "there is no such address"})
