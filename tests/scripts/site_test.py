#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""site_test.py SOURCE_DIR: the parts of the documentation site that need no Sphinx, on made pages, programs and a made repository."""

import pathlib
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(sys.argv[1])
SITE = ROOT / "scripts/site"


def run(*command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-B", *map(str, command)], capture_output=True, text=True, check=False)


def write(path: pathlib.Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def check_built_pages(work: pathlib.Path) -> None:
    html = work / "html"
    write(html / "index.html", '<h1 id="top">x</h1><a href="sub/page.html#part">a</a><a href="#top">b</a><a href="https://example.org">c</a>')
    write(html / "sub/page.html", '<p id="part"><a href="../index.html">x</a><img src="../picture.svg"></p>')
    write(html / "picture.svg", "<svg/>")
    good = run(SITE / "check_html.py", html)
    assert good.returncode == 0 and "2 pages, 4 internal links, 0 broken" in good.stdout, good
    faults = {
        '<a href="missing.html">x</a>': "links to missing.html, which is not in the site",
        '<a href="sub/page.html#nowhere">x</a>': "links to sub/page.html#nowhere, whose page has no such anchor",
        '<img src="gone.png">': "links to gone.png, which is not in the site",
        '<script src="https://example.org/a.js"></script>': "loads https://example.org/a.js; the site must work without a network",
        '<link rel="stylesheet" href="//example.org/a.css">': "loads //example.org/a.css; the site must work without a network",
    }
    for text, message in faults.items():
        write(html / "faulty.html", text)
        bad = run(SITE / "check_html.py", html)
        assert bad.returncode == 1 and f"faulty.html: {message}" in bad.stderr, (text, bad)


def check_pages(work: pathlib.Path) -> None:
    """Links of pages as the site has them; one that leads nowhere is an error."""
    tree = work / "tree"
    shutil.copytree(SITE, tree / "scripts/site")
    write(tree / "CONTRIBUTING.md", "# Rules\n\n[map](docs/" "map.md)\n")
    write(tree / "configs/a.yaml", "a: 1\n")
    write(tree / "docs/index.md", "# Home\n\n[map](map.md)\n")
    write(tree / "docs" / "map.md", "# Map\n\n[rules](../CONTRIBUTING.md#rules) [config](../configs/a.yaml) [folder](../configs) `[code](none.md)`\n"
          "\n```text\n[code](none.md)\n```\n")
    subprocess.run(["git", "init", "-q", tree], check=True)
    site = work / "site"
    result = run(tree / "scripts/site/pages.py", site)
    assert result.returncode == 0, result.stderr
    page = (site / "map.md").read_text(encoding="utf-8")
    for link in ("(contributing/rules.md#rules)", "(files/configs/a.yaml.md)", "(files/configs.md)", "`[code](none.md)`", "\n[code](none.md)\n"):
        assert link in page, (link, page)
    assert "(../map.md)" in (site / "contributing/rules.md").read_text(encoding="utf-8")
    assert "```yaml\na: 1\n```" in (site / "files/configs/a.yaml.md").read_text(encoding="utf-8")
    # Patterns of the navigation stay where pages match them that it does not name.
    write(tree / "docs" / "howto/datasets.md", "# Named\n")
    write(tree / "docs" / "reference/another.md", "# Another\n")
    assert run(tree / "scripts/site/pages.py", site).returncode == 0
    index = (site / "index.md").read_text(encoding="utf-8")
    assert "{toctree}" in index and "\nreference/*\n" in index and "\nhowto/*\n" not in index, index
    # A page that is gone leaves the site.
    (tree / "docs" / "map.md").unlink()
    write(tree / "docs/index.md", "# Home\n")
    write(tree / "CONTRIBUTING.md", "# Rules\n")
    assert run(tree / "scripts/site/pages.py", site).returncode == 0 and not (site / "map.md").exists()
    write(tree / "docs/index.md", "# Home\n\n[x](missing.md)\n")
    result = run(tree / "scripts/site/pages.py", site)
    assert result.returncode == 1 and "docs/index.md: links to missing.md" in result.stderr, result


HELP = {
    "": "Made: a program\nUsage: made [OPTIONS] SUBCOMMAND\n\nOptions:\n  -h,--help                   Print this help message and exit\n\n"
    "Subcommands:\n  one                         Does one thing\n  group                       Holds others\n\nExit codes: 0 done.\n",
    "one": "Does one thing\nUsage: made one [OPTIONS] FILE\n\nPositionals:\n  FILE TEXT REQUIRED          A file_name [a|b]\n\n"
    "Options:\n  -h,--help                   Print this help message and exit\n  --orientation FLOAT x 3 ... REQUIRED\n"
    "                              Three angles\n\nA note.\n\nExit codes: 0 done.\n",
    "group": "Holds others\nUsage: made group [OPTIONS] SUBCOMMAND\n\nOptions:\n  -h,--help                   Print this help message and exit\n\n"
    "Subcommands:\n  two                         Does another\n\nExit codes: 0 done.\n",
    "group two": "Does another\nUsage: made group two [OPTIONS]\n\nOptions:\n  -h,--help                   Print this help message and exit\n"
    "  --level INT=3               How far\n\nExit codes: 0 done.\n",
}


def check_commands(work: pathlib.Path) -> None:
    program = work / "made"
    cases = "".join(f"  '{words}') cat <<'END'\n{text}END\n  ;;\n" for words, text in HELP.items())
    write(program, f'#!/bin/bash\nset -- "${{@%--help}}"\ncase "$(echo "$@" | sed "s/ *$//")" in\n{cases}  *) exit 2 ;;\nesac\n')
    program.chmod(0o755)
    folder = work / "commands"
    folder.mkdir()
    result = run(SITE / "commands.py", program, folder)
    assert result.returncode == 0 and "3 commands" in result.stdout, result
    assert {path.name for path in folder.iterdir()} == {"index.md", "one.md", "group.md", "group_two.md"}
    one = (folder / "one.md").read_text(encoding="utf-8")
    for text in ("# earshot one\n", "`FILE TEXT REQUIRED`\n: A file\\_name \\[a\\|b\\]\n", "`--orientation FLOAT x 3 ... REQUIRED`\n: Three angles\n", "A note."):
        assert text in one, (text, one)
    assert "--help" not in one and "Exit codes" not in one, one
    assert "[two](group_two.md)" in (folder / "group.md").read_text(encoding="utf-8")
    assert "`--level INT=3`\n: How far" in (folder / "group_two.md").read_text(encoding="utf-8")


def check_config_keys(work: pathlib.Path) -> None:
    page = work / "config.md"
    program = work / "configured"
    for script, status, text in (
        ('echo "# Config keys"; echo "| a |"', 0, "# Config keys\n| a |\n"),
        ('echo "| a |"', 0, "# Config keys\n\n| a |\n"),
        ('echo "earshot: config: is not a command; one of: rir" >&2; exit 2', 0, "does not print its config keys"),
        ('echo "earshot: broken" >&2; exit 1', 1, None),
    ):
        write(program, f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        result = run(SITE / "config_keys.py", program, page)
        assert result.returncode == status, result
        assert text is None or text in page.read_text(encoding="utf-8"), (script, page.read_text(encoding="utf-8"))


def check_header_filter(work: pathlib.Path) -> None:
    """What is said before the namespace is said of the file; before a later one it is no documentation.  Lines keep their numbers."""
    header = work / "made.h"
    before = ["#pragma once", "", "/// Made things.", "/// Two lines.", "namespace made {", "", "/// A thing.", "struct Thing {};", "", "/// More.",
              "namespace inner {}", "}  // namespace made"]
    after = list(before)
    after[1], after[9] = "/// \\file", "// More."
    write(header, "\n".join(before) + "\n")
    result = run(SITE / "header_filter.py", header)
    assert result.returncode == 0 and result.stdout.splitlines() == after, result.stdout
    write(header, "#pragma once\n\nnamespace made {\n/// A thing.\nstruct Thing {};\n}\n")
    assert run(SITE / "header_filter.py", header).stdout == header.read_text(encoding="utf-8")


with tempfile.TemporaryDirectory() as name:
    work = pathlib.Path(name)
    check_built_pages(work)
    check_pages(work)
    check_commands(work)
    check_config_keys(work)
    check_header_filter(work)
print("site_test: links, pages, commands, config keys and headers")
