"""A batch's page shows the results of its clips in the order of review, and needs no server."""

from __future__ import annotations

from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from tests.test_batch_table import ENTRIES, FIRST, ODD
from viz.report.batch_page import batch_page, duration, write_batch_page


class BatchReader(HTMLParser):
    """What a page links to, the texts of its rows, and its elements."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.tags: list[str] = []
        self.rows: list[list[str]] = []
        self.inside = False  # a cell
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
            self.inside = True

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.rows[-1][-1] += data

    def handle_endtag(self, tag: str) -> None:
        self.inside = self.inside and tag not in ("td", "th")


def test_the_page_has_every_clip_as_text_and_nothing_from_elsewhere(tmp_path: Path) -> None:
    text = write_batch_page(tmp_path / "index.html", ENTRIES, f"spring {ODD}").read_text(encoding="utf-8")
    reader = BatchReader(text)
    # a file name is neither a scheme nor a query, and a clip's name is not markup
    assert sorted(reader.links) == ["a%20b%231.jpg", "data:,", "javascript%3Aalert%281%29", "r/50%25%3F.run"]
    assert reader.tags.count("script") == 1
    assert "<script>alert" not in text
    assert not any(word in text for word in ("http:", "https:", "url(", "@import"))
    rows = {row[2].split(ODD)[0]: row for row in reader.rows[1:]}
    assert tuple(row[2] for row in reader.rows[1:4]) == ("bad" + ENTRIES[3].message, "clip2report run file", "clip10")
    for entry, row in zip((ENTRIES[2], ENTRIES[4]), (rows["none, "], rows["founda finding "]), strict=True):
        assert row[2] == entry.name + ", ".join(filter(None, (entry.subject, entry.tracker))) + entry.message
        assert row[3:5] == [entry.status, entry.person]
    assert reader.rows[2] == [
        "2", "", "clip2report run file", "done", "ann", "200", "40", "0", "20.0", "", "1:02:03 h", "0.0 s",
    ]  # fmt: skip
    assert reader.rows[3][9] == "30.5"
    assert reader.rows[-1][5:] == [""] * 7
    assert "6 clips: 4 done, 1 failed, 1 waiting; 1,305 frames, 45 hard, 15 unobserved" in text


def test_a_page_of_no_clip_is_a_page() -> None:
    assert "0 clips: none; 0 frames" in batch_page([], "empty")


def test_durations() -> None:
    times = {0.04: "0.0 s", 59.94: "59.9 s", 59.96: "1:00 min", 3599.4: "59:59 min", 3599.6: "1:00:00 h"}
    assert {seconds: duration(seconds) for seconds in times} == times


SHOWN = "return rows.filter(row => !row.hidden).map(row => row.querySelector('b').textContent)"
ENTER, SPACE = "\ue007", "\ue00d"  # as WebDriver names the keys
IN_PAGE = "return [...document.querySelectorAll('tbody tr b')].map(name => name.textContent)"


@pytest.fixture
def opened(browser: Any, tmp_path: Path) -> Iterator[Any]:
    """The browser with the page of `ENTRIES`, from its file; others find it as it was."""
    browser.get("about:blank")
    browser.get_log("browser")  # discard messages of earlier pages
    browser.get(write_batch_page(tmp_path / "index.html", ENTRIES, "batch").as_uri())
    yield browser
    browser.get("about:blank")
    browser.get_log("browser")


def test_the_page_is_sorted_by_its_heads(opened: Any) -> None:
    """Numbers sort as numbers, names in natural order, missing values last in both directions; by keys too."""
    waiting = ENTRIES[2].name
    assert opened.execute_script(IN_PAGE) == [*FIRST, "clip9", waiting]
    heads = {head.text.split()[0]: head for head in opened.find_elements("tag name", "th") if head.text}

    def sort(name: str, key: str = "") -> tuple[list[str], str]:
        button = heads[name].find_element("tag name", "button")
        button.send_keys(key) if key else button.click()
        sorted_heads = opened.find_elements("css selector", "th[aria-sort]")
        assert sorted_heads == [heads[name]]
        return opened.execute_script(IN_PAGE), heads[name].get_attribute("aria-sort")

    names, way = sort("frames")
    assert (names[:5], way) == (["clip9", "clip2", "clip10", "found", "bad"], "descending")
    names, way = sort("frames", ENTER)
    assert (names, way) == (["found", "clip10", "clip2", "clip9", "bad", waiting], "ascending")
    assert sort("error", SPACE) == (["clip9", "clip10", "found", "clip2", "bad", waiting], "descending")
    assert sort("clip") == (["bad", "clip2", "clip9", "clip10", "found", waiting], "ascending")
    assert sort("person")[0][:2] == [waiting, "clip2"]
    assert sort("look") == ([*FIRST, waiting, "clip9"], "ascending")
    wrong = [entry["message"] for entry in opened.get_log("browser") if entry["level"] == "SEVERE"]
    assert all("a%20b" in message for message in wrong), wrong  # the missing picture


def test_the_page_shows_the_requested_clips(opened: Any) -> None:
    words = opened.find_element("id", "words")
    words.send_keys(" ANN")
    assert opened.execute_script(SHOWN) == ["clip2", "clip9"]
    assert opened.find_element("id", "shown").text == "2 of 6"
    words.clear()
    words.send_keys("a Finding  <script")
    assert opened.execute_script(SHOWN) == ["found"]
    words.clear()
    words.send_keys("script")
    assert opened.execute_script(SHOWN) == ["bad", "found", ENTRIES[2].name]
    buttons = {b.get_attribute("data-only"): b for b in opened.find_elements("css selector", "[data-only]")}
    assert [button.text for button in buttons.values()] == ["all 6", "to review 4", "done 4", "failed 1", "waiting 1"]
    buttons["failed"].click()
    assert opened.execute_script(SHOWN) == ["bad"]
    assert [name for name, button in buttons.items() if button.get_attribute("aria-pressed") == "true"] == ["failed"]
    words.send_keys(" nowhere")
    assert opened.execute_script(SHOWN) == []
    assert opened.find_element("id", "none").is_displayed()
