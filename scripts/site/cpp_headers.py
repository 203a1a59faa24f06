#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""cpp_headers.py FOLDER XML: Doxygen of the public headers into XML, and a page for each header into FOLDER.

The public headers are include/earshot/*.h, or, in a tree without that folder, those that docs/howto/library.md names.
A warning of Doxygen is an error.
"""

import pathlib
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree

from output import escape, remove_others, write_if_new

ROOT = pathlib.Path(__file__).resolve().parents[2]


def public_headers() -> list[str]:
    folder = ROOT / "include/earshot"
    if folder.is_dir():
        return sorted(str(path.relative_to(ROOT)) for path in folder.glob("*.h"))
    page = (ROOT / "docs/howto/library.md").read_text(encoding="utf-8")
    return sorted({name for name in re.findall(r"`([\w/]+\.h)`", page) if (ROOT / name).is_file()})


def doxyfile(headers: list[str], xml: pathlib.Path) -> str:
    settings = {
        "PROJECT_NAME": "Earshot",
        "INPUT": " ".join(f'"{ROOT / header}"' for header in headers),
        "OUTPUT_DIRECTORY": f'"{xml.parent}"',
        "XML_OUTPUT": xml.name,
        "STRIP_FROM_PATH": f'"{ROOT}"',
        "GENERATE_XML": "YES",
        "GENERATE_HTML": "NO",
        "GENERATE_LATEX": "NO",
        "XML_PROGRAMLISTING": "NO",
        "EXTRACT_ALL": "YES",
        # The first sentence of a comment is the brief description; `#` and `::` in a comment are no links.
        "JAVADOC_AUTOBRIEF": "YES",
        "AUTOLINK_SUPPORT": "NO",
        "INPUT_FILTER": f'"{sys.executable} -B {pathlib.Path(__file__).with_name("header_filter.py")}"',
        "ENABLE_PREPROCESSING": "YES",
        "MACRO_EXPANSION": "YES",
        "SEARCH_INCLUDES": "NO",
        "HAVE_DOT": "NO",
        "QUIET": "YES",
        # A parameter whose type and name say all needs no line.
        "WARN_IF_UNDOCUMENTED": "NO",
        "WARN_IF_INCOMPLETE_DOC": "NO",
        "WARN_AS_ERROR": "FAIL_ON_WARNINGS",
    }
    return "".join(f"{key} = {value}\n" for key, value in settings.items())


def is_in(definition: xml.etree.ElementTree.Element, header: str) -> bool:
    location = definition.find("location")
    return location is not None and location.get("file", "").removeprefix(str(ROOT) + "/") == header


def declared_by(xml: pathlib.Path, header: str) -> tuple[str, list[str]]:
    """What a header says of itself in one sentence, if it does, and the names of its classes and functions."""
    for entry in xml.glob("*_8h.xml"):
        definition = xml_root(entry).find("compounddef")
        if definition is None or not is_in(definition, header):
            continue
        brief = " ".join("".join(definition.find("briefdescription").itertext()).split())
        names = [inner.text for inner in definition.iter("innerclass")]
        for inner in definition.iter("innernamespace"):
            members = xml_root(xml / f"{inner.get('refid')}.xml").iter("memberdef")
            names += [member.findtext("name") for member in members if is_in(member, header)]
        # A class within a class, and the second of two functions of a name, add nothing.
        names = list(dict.fromkeys(name.removeprefix("earshot::").removeprefix("api::") for name in names if name))
        return brief, [name for name in names if "::" not in name]
    return "", []


def xml_root(path: pathlib.Path) -> xml.etree.ElementTree.Element:
    return xml.etree.ElementTree.parse(path).getroot()


def main(folder: pathlib.Path, xml_folder: pathlib.Path) -> None:
    headers = public_headers()
    config = xml_folder.parent / "Doxyfile"
    write_if_new(config, doxyfile(headers, xml_folder))
    index = folder / "index.md"
    sources = [config, *(ROOT / header for header in headers), *pathlib.Path(__file__).parent.glob("*header*.py")]
    if index.is_file() and all(path.stat().st_mtime < index.stat().st_mtime for path in sources):
        return
    shutil.rmtree(xml_folder, ignore_errors=True)
    if subprocess.run(["doxygen", str(config)], cwd=ROOT, check=False).returncode != 0:
        sys.exit("docs: Doxygen warns of the comments above; correct them in the headers")
    folder.mkdir(parents=True, exist_ok=True)
    rows, names = "", []
    for header in headers:
        include = header.removeprefix("include/")
        name = include.removesuffix(".h").replace("/", "_")
        names.append(name)
        page = f"# {include}\n\n```cpp\n#include \"{include}\"\n```\n\n```{{doxygenfile}} {pathlib.PurePath(header).name}\n:sections: briefdescription detaileddescription innernamespace innerclass"
        page += " enum typedef define func var public-type public-attrib public-func public-static-attrib public-static-func friend\n```\n"
        # Written anew with Doxygen's XML, so that Sphinx reads both again.
        (folder / f"{name}.md").write_text(page, encoding="utf-8")
        brief, declared = declared_by(xml_folder, header)
        rows += f"| [{include}]({name}.md) | {escape(brief)}{' ' if brief else ''}{', '.join(f'`{each}`' for each in declared)} |\n"
    text = "# C++\n\nThe public headers. How to find and link the library: [Earshot as a library](../../howto/library.md).\n\n"
    text += "| header | declares |\n|---|---|\n" + rows + "\n```{toctree}\n:hidden:\n\n" + "\n".join(names) + "\n```\n"
    index.write_text(text, encoding="utf-8")
    remove_others(folder, {folder / f"{name}.md" for name in [*names, "index"]})
    print(f"docs: {len(headers)} public headers")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]))
