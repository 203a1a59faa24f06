# SPDX-License-Identifier: Apache-2.0
"""Writes generated pages, leaving those alone that are the same: Sphinx reads again what is newer than its last build."""

import pathlib


def write_if_new(path: pathlib.Path, content: str | bytes) -> None:
    data = content.encode() if isinstance(content, str) else content
    if path.is_file() and path.read_bytes() == data:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def remove_others(folder: pathlib.Path, wanted: set[pathlib.Path]) -> None:
    """Removes the files of earlier builds below folder that are not among the wanted ones."""
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir():
            if not any(path.iterdir()):
                path.rmdir()
        elif path not in wanted:
            path.unlink()


def escape(text: str) -> str:
    """Plain text as Markdown; code between backticks stays code."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        parts = [text.replace("`", "\\`")]
    for i in range(0, len(parts), 2):
        for character in "\\*_[]<>#|$~":
            parts[i] = parts[i].replace(character, "\\" + character)
    return "`".join(parts)
