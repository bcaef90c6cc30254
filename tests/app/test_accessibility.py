"""axe-core finds nothing to mend in any view, in light and dark."""

import importlib.util
from pathlib import Path

import pytest

from tests.app.browser import Page
from tests.app.conftest import Server
from tests.app.test_api import ended

RUN = """
const done = arguments[0];
axe.run(document, { resultTypes: ["violations"] }).then(({ violations }) => done(violations.map(
  ({ id, nodes }) => `${id}: ${nodes.map((each) => each.html.slice(0, 120)).join(" | ")}`)));
"""


@pytest.fixture(scope="module")
def axe() -> str:
    """The script of axe-core."""
    found = importlib.util.find_spec("axe_core_python")
    if found is None or found.origin is None:
        pytest.skip("axe-core-python is not installed")
    return (Path(found.origin).parent / "axe.min.js").read_text(encoding="utf-8")


def test_no_view_has_a_violation(
    page: Page, server: Server, files: tuple[Path, Path], axe: str
) -> None:
    far, near = (server.ref(file) for file in files)
    pair = {"far": far, "near": near}
    request = {"kind": "localize", "max_effort": "points"}
    found = ended(server, server.post("/api/jobs", request | pair))["id"]
    missed = ended(server, server.post("/api/jobs", request | {"far": far, "near": far}))["id"]
    batch = server.post("/api/batches", {"far": far, "folder": far.rpartition("/")[0]})["id"]
    server.post(f"/api/batches/{batch}/cancel")
    note = server.post("/api/annotations", pair)["annotation"]["id"]
    views = {
        "#/localize": "#localize", "#/batch": "#batch", "#/map": "main h1", "#/results": "main h1",
        "#/annotate": "#annotate", f"#/localize/{found}": ".viewer[data-ready]",
        f"#/localize/{missed}": ".side h3, .verdict", f"#/batch/{batch}": "tbody a",
        f"#/annotate/{note}": ".editor[data-ready]", f"#/world/job/{found}": ".empty h2",
        "#/kept": "main h1",
    }  # fmt: skip
    wrong = {}
    for theme in ("light", "dark"):
        feature = [{"name": "prefers-color-scheme", "value": theme}]
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": feature})
        for view, shown in views.items():
            page.open(view)
            page.find(shown)
            page.driver.execute_script(axe)
            wrong[theme, view] = page.driver.execute_async_script(RUN)
        page.press("?")
        page.find("dialog[open]")
        wrong[theme, "help"] = page.driver.execute_async_script(RUN)
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert not {view: said for view, said in wrong.items() if said}
    assert not page.errors()
