#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""commands.py PROGRAM FOLDER: writes a page for each command of the program from what it prints with --help."""

import concurrent.futures
import os
import pathlib
import re
import subprocess
import sys

from output import escape, remove_others, write_if_new

# "  NAME TYPE   what it is": the description begins in a column of its own, or alone on the next line.
ENTRY = re.compile(r"^  (\S.*?)(?:\s{2,}(\S.*))?$")
CONTINUED = re.compile(r"^\s{10,}(\S.*)$")


def help_of(program: str, words: list[str]) -> str:
    result = subprocess.run([program, *words, "--help"], capture_output=True, text=True, timeout=120, check=False)
    if result.returncode != 0:
        sys.exit(f"docs: {' '.join([program, *words])} --help ends with {result.returncode}: {result.stderr.strip()}")
    return result.stdout


class Help:
    """The parts of a help text: description, usage, sections of entries (name, description), and what follows them."""

    def __init__(self, text: str):
        self.description, self.usage, self.footer = [], "", []
        self.sections: dict[str, list[list[str]]] = {}
        entries = None
        for line in text.splitlines():
            if heading := re.match(r"^(\[Option Group: .+\]|[A-Z][\w ]*):?$", line) if line.endswith((":", "]")) else None:
                entries = self.sections.setdefault(heading[1].strip("[]").removeprefix("Option Group: "), [])
            elif line.startswith("Usage:"):
                self.usage = line.removeprefix("Usage:").strip()
            elif entries is not None and entries and (more := CONTINUED.match(line)):
                entries[-1][1] = f"{entries[-1][1]} {more[1]}".strip()
            elif entries is not None and (entry := ENTRY.match(line)):
                entries.append([entry[1], entry[2] or ""])
            elif not self.usage:
                self.description.append(line)
            elif line.strip() or self.footer:
                entries = None
                self.footer.append(line)

    @property
    def commands(self) -> list[tuple[str, str]]:
        return [(name, text) for name, text in self.sections.get("Subcommands", [])]


def section_text(title: str, entries: list[list[str]]) -> str:
    text = f"## {title}\n\n"
    for name, description in entries:
        text += f"`{name}`\n: {escape(description) or '(no description)'}\n\n"
    return text


def page_of(words: list[str], help_text: Help, common_footer: list[str]) -> str:
    name = " ".join(["earshot", *words])
    text = f"# {name}\n\n{escape(' '.join(help_text.description).strip())}.\n\n```text\n{help_text.usage}\n```\n\n".replace("..\n", ".\n")
    footer = [line for line in help_text.footer if line not in common_footer]
    for title, entries in help_text.sections.items():
        entries = [entry for entry in entries if not entry[0].startswith("-h,")]
        if entries and title != "Subcommands":
            text += section_text(title, entries)
    if any(line.strip() for line in footer):
        text += "## Notes\n\n```text\n" + "\n".join(footer).strip() + "\n```\n\n"
    return text


def read_commands(program: str) -> tuple[Help, list[tuple[list[str], str, Help]]]:
    """The help of the program, and words, purpose and help of each command, one below another as the program lists them."""
    top = Help(help_of(program, []))
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        def read(level: list[tuple[list[str], str]]) -> list[tuple[list[str], str, Help]]:
            helps = [Help(text) for text in pool.map(lambda command: help_of(program, command[0]), level)]
            commands = []
            for (words, purpose), parsed in zip(level, helps):
                commands += [(words, purpose, parsed), *read([([*words, child], text) for child, text in parsed.commands])]
            return commands

        return top, read([([name], text) for name, text in top.commands])


def main(program: str, folder: pathlib.Path) -> None:
    index = folder / "index.md"
    sources = [pathlib.Path(program).parent / name for name in ("earshot", "earshot_training")] + [pathlib.Path(__file__)]
    if index.is_file() and all(not path.is_file() or path.stat().st_mtime < index.stat().st_mtime for path in sources):
        return
    top, commands = read_commands(program)
    common_footer = [line for line in top.footer if line]
    rows = ""
    for words, purpose, parsed in commands:
        page = "_".join(words)
        text = page_of(words, parsed, common_footer)
        if parsed.commands:
            text += "| command | purpose |\n|---|---|\n"
            text += "".join(f"| [{child}]({page}_{child}.md) | {escape(what)} |\n" for child, what in parsed.commands)
        write_if_new(folder / f"{page}.md", text)
        rows += f"| [earshot {' '.join(words)}]({page}.md) | {escape(purpose)} |\n"
    names = ["_".join(words) for words, _, _ in commands]
    text = "# Commands\n\n`earshot COMMAND --help` prints these pages; `earshot completion man` prints them as a manual page.\n\n"
    text += "| command | purpose |\n|---|---|\n" + rows
    text += "\n## Scenes and exit codes\n\n" + "\n\n".join(escape(line) for line in common_footer) + "\n"
    text += "\n```{toctree}\n:hidden:\n\n" + "\n".join(names) + "\n```\n"
    index.write_text(text, encoding="utf-8")
    remove_others(folder, {folder / f"{name}.md" for name in [*names, "index"]})
    print(f"docs: {len(names)} commands")


if __name__ == "__main__":
    main(sys.argv[1], pathlib.Path(sys.argv[2]))
