#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""check_html.py FOLDER: fails if a page of the built site links to a page, file or anchor that is not there, or loads anything over the network."""

import html.parser
import pathlib
import sys
import urllib.parse


class Page(html.parser.HTMLParser):
    def __init__(self, text: str):
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attributes}
        self.anchors |= {values[key] for key in ("id", "name") if key in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag == "link" and values.get("rel") in ("stylesheet", "preload", "icon", "shortcut icon"):
            self.loaded.append(values.get("href", ""))
        if tag in ("script", "img", "iframe", "source", "video", "audio") and "src" in values:
            self.loaded.append(values["src"])


def main(root: pathlib.Path) -> int:
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in sorted(root.rglob("*.html")) if "_static" not in path.parts}
    errors, num_links = [], 0
    for path, page in pages.items():
        name = path.relative_to(root)
        for target in page.loaded:
            if urllib.parse.urlsplit(target).scheme in ("http", "https") or target.startswith("//"):
                errors.append(f"{name}: loads {target}; the site must work without a network")
        for target in page.links + page.loaded:
            parts = urllib.parse.urlsplit(target)
            if parts.scheme or parts.netloc or not target:
                continue
            num_links += 1
            file = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
            if file.is_dir():
                file /= "index.html"
            anchor = urllib.parse.unquote(parts.fragment)
            if not file.is_file():
                errors.append(f"{name}: links to {target}, which is not in the site")
            elif anchor and file in pages and anchor not in pages[file].anchors:
                errors.append(f"{name}: links to {target}, whose page has no such anchor")
    for error in sorted(set(errors)):
        print(f"docs: {error}", file=sys.stderr)
    print(f"docs: {len(pages)} pages, {num_links} internal links, {len(set(errors))} broken")
    return int(bool(errors))


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]).resolve()))
