"""What MkDocs needs to show the documents as they stand in the repository, where links must work too."""

from __future__ import annotations

import re
from pathlib import Path
from posixpath import dirname, join, normpath, relpath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT_PAGES = {
    "README.md": "index.md",
    "ARCHITECTURE.md": "architecture.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
"""Documents beside `docs/` and the pages that stand for them in the site."""
_LINK = re.compile(r"^```.*?^```|\]\((?!\w+:|#|/)([^)#\s]+)", re.DOTALL | re.MULTILINE)
"""Where a link of the repository leads; blocks of code are met first, and left as they are."""


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Adds the documents that stand beside `docs/` as pages; the index stands for the README."""
    root = Path(config.docs_dir).parent
    for document, page in ROOT_PAGES.items():
        if page != "index.md":
            files.append(File.generated(config, page, content=(root / document).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turns links between documents of the repository into links between pages."""
    place = page.file.src_uri
    documents = {name: document for document, name in ROOT_PAGES.items() if name != "index.md"}
    document = documents.get(place, f"docs/{place}")
    return _LINK.sub(lambda match: f"]({_page_link(document, place, match[1])}" if match[1] else match[0], markdown)


def _page_link(document: str, place: str, link: str) -> str:
    target = normpath(join(dirname(document), link))
    page = ROOT_PAGES.get(target, target.removeprefix("docs/"))
    return relpath(page, dirname(place) or ".")
