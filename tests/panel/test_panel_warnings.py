"""Warnings of saved and of fresh results, whatever version of the plugin has written them."""

import json
import shutil
from pathlib import Path

import pytest

pytestmark = pytest.mark.one_python

SAVED = Path(__file__).parents[1] / "plugin" / "saved-28418b1" / "control-scale.json"
SAID = "<b>A newer one</b>"


@pytest.fixture
def planted(stand_in, tasks):
    """A saved measurement of 28418b1 among those of the task."""
    task = tasks["Mine"]
    place = f"media/project/{task['project']}/task/{task['id']}/assets/volcalc"
    folder = stand_in[1] / place
    folder.mkdir(exist_ok=True)
    document = json.loads(SAVED.read_text())
    path = folder / f"{document['id']}.json"
    shutil.copy(SAVED, path)
    yield document
    path.unlink()


@pytest.mark.parametrize("fresh", [False, True])
def test_texts_and_objects_are_shown_alike(open_page, tasks, planted, fresh):
    page = open_page().open(("Mine", tasks["Mine"])).open_panel()
    said = ["A text of quantify-client/1", {"code": "new", "text": SAID, "values": {"share": 0.5}}]

    def with_both(route):
        document = route.fetch().json()
        document["measurement"]["warnings"] = said
        document["measurement"]["results"][0]["warnings"] = [said[1]]
        route.fulfill(json=document)

    if fresh:  # as the worker has written it, in the schema of its version
        page.page.route(f"**/measurements/{planted['id']}", with_both)
    page.page.click("role=tab[name=/^Saved/]")
    page.page.click(f".vc-saved .vc-link >> text={planted['name']}")
    page.page.wait_for_selector(".vc-hero")
    shown = page.page.locator(".vc-warning").all_inner_texts()
    if fresh:
        assert sum(SAID in text for text in shown) == 2
        assert any("A text of quantify-client/1" in text for text in shown)
    else:
        assert len(shown) == len(planted["measurement"]["warnings"]) == 3
    assert not any("[object" in text for text in shown)
    assert page.page.locator(".vc-warning b").count() == 0
