#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""pages.py FOLDER: copies the pages of docs/ and what they show into FOLDER, the source of the site.

A page links to files of the repository as a reader of the repository sees them.  In the site a link to a file outside docs/, or to one that is
no page, leads to a page of its own with the content of that file or the list of that folder.  A link that leads nowhere is an error.
"""

import os
import pathlib
import re
import subprocess
import sys

from output import remove_others, write_if_new

ROOT = pathlib.Path(__file__).resolve().parents[2]
# Pages of the root, and their names in the site.
ROOT_PAGES = {"CONTRIBUTING.md": "contributing/rules.md", "CHANGELOG.md": "contributing/changelog.md", "SECURITY.md": "contributing/security.md"}
# Pages of docs/ that the site replaces by generated ones (config_keys.py).
GENERATED = {"docs/reference/config.md"}
PICTURES = {".svg", ".png", ".jpg"}
LANGUAGES = {".cpp": "cpp", ".h": "cpp", ".py": "python", ".sh": "sh", ".yaml": "yaml", ".json": "json", ".cmake": "cmake", ".sbatch": "sh"}
MAX_SHOWN_BYTES = 200_000


def page_of(path: str) -> str | None:
    """The page of the site that a file of the repository is, or none."""
    if path in ROOT_PAGES:
        return ROOT_PAGES[path]
    if path == "docs":
        return "index.md"
    if path.startswith("docs/") and path.endswith(".md"):
        return path.removeprefix("docs/")
    return None


def split_code(text: str) -> list[tuple[str, bool]]:
    """Parts of a page and whether each is code: fenced blocks and code spans."""
    parts, end = [], 0
    for match in re.finditer(r"^(```+|~~~+)[^\n]*\n.*?^\1[ \t]*$|(?<!`)(`+)(?!`)[^\n]*?(?<!`)\2(?!`)", text, flags=re.S | re.M):
        parts += [(text[end:match.start()], False), (match.group(), True)]
        end = match.end()
    return [*parts, (text[end:], False)]


class Assembler:
    def __init__(self, target: pathlib.Path):
        self.target = target
        self.tracked = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split("\n")
        self.tracked = sorted(path for path in self.tracked if path and (ROOT / path).is_file())
        self.folders = {str(parent) for path in self.tracked for parent in pathlib.PurePath(path).parents}
        self.files = set(self.tracked)
        self.shown: set[str] = set()
        self.written: set[pathlib.Path] = set()
        self.errors: list[str] = []

    def write(self, name: str, content: str | bytes) -> None:
        path = self.target / name
        write_if_new(path, content)
        self.written.add(path)

    def show(self, path: str) -> str:
        """Makes a page of a file or a folder of the repository, and returns its name."""
        name = f"files/{path}.md"
        if path in self.shown:
            return name
        self.shown.add(path)
        head = f"---\norphan: true\n---\n# {path}\n\n"
        if path in self.folders:
            inside = [file for file in self.tracked if file.startswith(path + "/")]
            self.write(name, head + "Files of this folder in the repository:\n\n" + "".join(f"- `{file}`\n" for file in inside))
            return name
        data = (ROOT / path).read_bytes()
        if b"\0" in data[:4096] or len(data) > MAX_SHOWN_BYTES:
            self.write(name, head + f"`{path}` of the repository has {len(data):,} bytes, which are not shown here.\n")
            return name
        text = data.decode(errors="replace").rstrip()
        fence = "`" * max(3, 1 + max((len(ticks) for ticks in re.findall(r"^`+", text, flags=re.M)), default=0))
        self.write(name, head + f"{fence}{LANGUAGES.get(pathlib.PurePath(path).suffix, 'text')}\n{text}\n{fence}\n")
        return name

    def link(self, source: str, page: str, target: str, is_picture: bool) -> str:
        """A link of the file `source`, which is the page `page` of the site, as the site has it."""
        if re.match(r"[a-z]+:|#|<", target) or not target:
            return target
        path, _, anchor = target.partition("#")
        full = os.path.normpath(os.path.join(os.path.dirname(source), path))
        if full not in self.files and full not in self.folders:
            self.errors.append(f"{source}: links to {target}, which the repository does not have")
            return target
        name = page_of(full)
        if name is None and pathlib.PurePath(full).suffix in PICTURES and full.startswith("docs/"):
            name = full.removeprefix("docs/")
        if name is None:
            name = self.show(full)
        return os.path.relpath(name, os.path.dirname(page) or ".") + ("#" + anchor if anchor else "")

    def add_page(self, source: str, page: str, appended: str = "") -> None:
        text = (ROOT / source).read_text(encoding="utf-8")
        pattern = re.compile(r"(!?)(\[(?:[^\]\[]|\[[^\]]*\])*\]\()([^)\s]+)(\))")
        linked = "".join(
            part if is_code else pattern.sub(lambda m: m[1] + m[2] + self.link(source, page, m[3], bool(m[1])) + m[4], part)
            for part, is_code in split_code(text)
        )
        self.write(page, linked + appended)

    def navigation(self) -> str:
        """navigation.md without the patterns that no further page matches, which Sphinx warns of."""
        text = pathlib.Path(__file__).with_name("navigation.md").read_text(encoding="utf-8")
        lines = text.splitlines(keepends=True)
        pages = {page.removesuffix(".md") for path in self.tracked if (page := page_of(path))} - {line.strip() for line in lines}
        matches = {line for line in lines if line.strip().endswith("/*") and any(str(pathlib.PurePath(page).parent) + "/*" == line.strip() for page in pages)}
        return "".join(line for line in lines if not line.strip().endswith("/*") or line in matches)

    def run(self) -> int:
        navigation = self.navigation()
        for path in self.tracked:
            page = page_of(path)
            if path in GENERATED:
                continue
            if page is not None:
                self.add_page(path, page, "\n" + navigation if page == "index.md" else "")
            elif path.startswith("docs/") and pathlib.PurePath(path).suffix in PICTURES:
                self.write(path.removeprefix("docs/"), (ROOT / path).read_bytes())
        self.write("_static/site.css", pathlib.Path(__file__).with_name("site.css").read_bytes())
        for name in ("reference/commands", "reference/cpp"):
            self.written |= set((self.target / name).rglob("*"))
        self.written |= {self.target / "reference/python.rst", self.target / "reference/config.md"}
        remove_others(self.target, self.written)
        for error in self.errors:
            print(f"docs: {error}", file=sys.stderr)
        return int(bool(self.errors))


if __name__ == "__main__":
    sys.exit(Assembler(pathlib.Path(sys.argv[1]).resolve()).run())
