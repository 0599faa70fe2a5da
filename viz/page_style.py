"""The look that pages to read have in common: type, tables, tags, links, sentences."""

from __future__ import annotations

import re
from html import escape
from pathlib import Path


def page_style() -> str:
    """Rules for the head of a page; a page's own rules follow them. Colours are variables, which a page may change."""
    return Path(__file__).with_name("page_style.css").read_text(encoding="utf-8")


def text(said: str) -> str:
    """A sentence as HTML; what stands between backquotes is code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(said))
