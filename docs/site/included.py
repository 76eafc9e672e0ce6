"""Text that stands elsewhere in the repository, taken into a page instead of being written twice.

    <!-- include README.md -->                   the whole file without its title
    <!-- include README.md: Limitations -->      one section without its heading, with what lies below it

Links are made to lead to the same place from the page: to the page of the site where there is one, under its title
where they read as its file's name; what else lies in the repository becomes its name alone. Figures of a table do not
break.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent

# Files of the repository that are pages of the site under another name.
PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "experiments/RESULTS.md": "results.md",
}

_INCLUDE = re.compile(r"^<!-- include ([\w./-]+)(?:: (.+?))? -->$", re.MULTILINE)
_LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
_FENCE = re.compile(r"^(`{3,}|~{3,}).*?^\1 *$", re.MULTILINE | re.DOTALL)
_NAME = re.compile(r"`?[\w./-]+\.\w+`?")
_FIGURES = re.compile(r"(?<=\d) (±|of|to) (?=\d)|(?<=\d) (?=\([\d.]+\))|(?<=±) (?=\d)")
_HEADING = re.compile(r"^(#+) (.+)$", re.MULTILINE)


def section(text: str, heading: str | None) -> str:
    """A section without its heading, up to the next one of its rank; of None the whole text without its title.

    Raises:
        ValueError: unless exactly one heading reads so.
    """
    code = [range(*fence.span()) for fence in _FENCE.finditer(text)]
    found = [match for match in _HEADING.finditer(text) if not any(match.start() in span for span in code)]
    chosen = found[:1] if heading is None else [match for match in found if match[2] == heading]
    if len(chosen) != 1:
        raise ValueError(f"section {heading!r}: expected one, given {len(chosen)}")
    (first,) = chosen
    later = (match.start() for match in found if match.start() > first.start() and len(match[1]) <= len(first[1]))
    return text[first.end() : next(later, len(text))].strip("\n")


def relinked(text: str, source: Path, page: Path) -> str:
    """Links of a text from a file, as they have to stand in a page of the site."""

    def link(match: re.Match[str]) -> str:
        image, shown, target = match.groups()
        path, hash_, anchor = target.partition("#")
        if "://" in target or target.startswith(("mailto:", "#")) or not path:
            return match[0]
        aim = (source.parent / path).resolve()
        if not aim.is_relative_to(ROOT):
            return match[0]
        aim = DOCS / PAGES.get(aim.relative_to(ROOT).as_posix(), os.path.relpath(aim, DOCS))
        named = _NAME.fullmatch(shown) is not None
        if not aim.resolve().is_relative_to(DOCS):
            return f"`{shown.strip('`')}`" if named else shown
        if named and aim.suffix == ".md":
            shown = _title(aim)
        return f"{image}[{shown}]({os.path.relpath(aim, page.parent)}{hash_}{anchor})"

    return _LINK.sub(link, text)


def _title(page: Path) -> str:
    found = _HEADING.search(page.read_text(encoding="utf-8"))
    return page.name if found is None else found[2]


def unbroken(text: str) -> str:
    """The same, where figures in tables stay in one line: 50 of 50, 1.2 ± 0.3, 4 (5)."""

    def kept(match: re.Match[str]) -> str:
        return match[0].replace(" ", "\N{NO-BREAK SPACE}")

    lines = text.split("\n")
    return "\n".join(_FIGURES.sub(kept, line) if line.startswith("|") else line for line in lines)


def page_of(text: str, page: Path) -> str:
    """The source of a page with all that it includes, and links that lead somewhere on the site."""

    def taken(match: re.Match[str]) -> str:
        source = ROOT / match[1]
        return relinked(section(source.read_text(encoding="utf-8"), match[2]), source, page)

    return unbroken(_INCLUDE.sub(taken, relinked(text, page, page)))


def _read(app: Sphinx, name: str, content: list[str]) -> None:
    page = Path(app.env.doc2path(name))
    if page.suffix == ".md":
        for match in _INCLUDE.finditer(content[0]):
            app.env.note_dependency(str(ROOT / match[1]))
        content[0] = page_of(content[0], page)


def setup(app: Sphinx) -> dict[str, bool]:
    """Rewrite pages as they are read."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
