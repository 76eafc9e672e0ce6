"""Check a built site: `python docs/site/links.py FOLDER`.

Every link and every picture leads to a file of the site, every anchor to an element, and no page loads anything from
elsewhere, so that the site works from disk.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADED = {("script", "src"), ("img", "src"), ("link", "href"), ("iframe", "src"), ("video", "src"), ("source", "src")}


class _Page(HTMLParser):
    """The anchors of a page, and what it points to: tag and address."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.anchors, self.links = set[str](), list[tuple[str, str, str]]()
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            elif name in ("href", "src") and value is not None:
                self.links.append((tag, name, value))


def faults(site: Path) -> list[str]:
    """What is wrong, one sentence each."""
    pages = {file.resolve(): _Page(file) for file in sorted(site.rglob("*.html"))}
    if not pages:
        return [f"{site}: expected pages, given none"]
    found = []
    for file, page in pages.items():
        for tag, attribute, address in page.links:
            where = f"{file.relative_to(site.resolve())}: {address}"
            parts = urlsplit(address)
            if parts.scheme in ("http", "https") or parts.netloc:
                if (tag, attribute) in _LOADED:
                    found.append(f"{where} is loaded from elsewhere")
            elif not parts.scheme:
                aim = (file.parent / unquote(parts.path)).resolve() if parts.path else file
                aim = aim / "index.html" if aim.is_dir() else aim
                if not aim.is_file():
                    found.append(f"{where} leads nowhere")
                elif parts.fragment and aim in pages and unquote(parts.fragment) not in pages[aim].anchors:
                    found.append(f"{where}: no such place on that page")
    return found


if __name__ == "__main__":
    wrong = faults(Path(sys.argv[1]))
    print(*wrong, sep="\n", end="\n" if wrong else "")
    sys.exit(bool(wrong))
