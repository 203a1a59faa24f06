#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes a software bill of materials (CycloneDX 1.5, JSON).

make_sbom.py program FILE --version V [--strict] -o OUT
    Of a program: the packages that own the libraries it asks for (NEEDED), and those whose headers are compiled in.
make_sbom.py wheel LIST TREE [--nanobind V]
    Of an unpacked wheel, into TREE/*.dist-info/sboms (PEP 770).  LIST: a line "FILE PACKAGE" for each library that was copied in.
make_sbom.py licence PACKAGE...
    Prints a line "PACKAGE SPDX-EXPRESSION" for each installed package.  Status 1 where a licence is not known.

Versions are those of dpkg, licences those of scripts/library_licences.txt.  The same input gives the same bytes: the serial number is a hash, the time is
SOURCE_DATE_EPOCH or that of the commit, and absent without both.
--strict: status 1 where a package or a licence is not known; otherwise this is a warning.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import re
import subprocess
import sys
import uuid
from datetime import datetime, timezone
from pathlib import Path
from urllib.parse import quote

ROOT = Path(__file__).resolve().parents[1]
# Headers (and a script, three.js) that end up inside the files; installed packages among them are listed.
COMPILED_IN = {
    "program": ["libglm-dev", "nlohmann-json3-dev", "libcli11-dev", "cppzmq-dev", "libmsgpack-cxx-dev", "libgloo-dev", "libopenmpi-dev", "libjs-three"],
    "wheel": ["libglm-dev", "nlohmann-json3-dev"],
}
unknown: list[str] = []


def output_of(*command: str) -> str:
    return subprocess.run(command, env={**os.environ, "LC_ALL": "C"}, capture_output=True, text=True, check=False).stdout


def fail(text: str) -> None:
    print(f"make_sbom: {text}", file=sys.stderr)
    sys.exit(2)


def known_licences() -> dict[str, str]:
    lines = (line.split("#")[0].split(None, 1) for line in (ROOT / "scripts" / "library_licences.txt").read_text().splitlines())
    return {words[0]: words[1].strip() for words in lines if words}


def installed(packages: list[str]) -> dict[str, dict[str, str]]:
    """By the name of a package: version, architecture and source package."""
    text = output_of("dpkg-query", "-W", "-f", "${Package}\t${Version}\t${Architecture}\t${source:Package}\t${db:Status-Abbrev}\n", *packages) if packages else ""
    rows = (line.split("\t") for line in text.splitlines())
    return {row[0]: {"version": row[1], "architecture": row[2], "source": row[3]} for row in rows if row[4].startswith("ii")}


def licence_of(package: str, source: str, licences: dict[str, str]) -> str | None:
    if source not in licences:
        unknown.append(f"scripts/library_licences.txt has no licence of {source}; add that of /usr/share/doc/{package}/copyright")
    return licences.get(source)


def distribution() -> str:
    fields = dict(re.findall(r'^(\w+)="?([^"\n]*)', Path("/etc/os-release").read_text(), re.MULTILINE))
    return f"{fields.get('ID', 'linux')}-{fields.get('VERSION_ID') or fields.get('VERSION_CODENAME', '')}".rstrip("-")


def debian_component(package: str, row: dict[str, str], linkage: str, files: list[dict]) -> dict:
    system = distribution()
    purl = (
        f"pkg:deb/{system.split('-')[0]}/{quote(package, safe='')}@{quote(row['version'], safe='')}?arch={row['architecture']}&distro={system}"
    )
    component: dict = {"type": "library", "bom-ref": purl, "name": package, "version": row["version"]}
    if expression := licence_of(package, row["source"], known_licences()):
        component["licenses"] = [{"expression": expression}]
    component["purl"] = purl
    component["properties"] = [{"name": "earshot:linkage", "value": linkage}, {"name": "earshot:source_package", "value": row["source"]}]
    if files:
        component["components"] = sorted(files, key=lambda file: file["name"])
    return component


def file_component(name: str, path: Path | None) -> dict:
    component: dict = {"type": "file", "name": name}
    if path is not None:
        component["hashes"] = [{"alg": "SHA-256", "content": hashlib.sha256(path.read_bytes()).hexdigest()}]
    return component


def needed_libraries(program: Path) -> list[str]:
    return re.findall(r"\(NEEDED\).*\[(.*)\]", output_of("readelf", "-d", str(program)))


def owners(sonames: list[str]) -> dict[str, str]:
    """The package of each library, by the file that the loader takes for this processor."""
    places: dict[str, str] = {}
    for line in output_of("ldconfig", "-p").splitlines():
        if (match := re.match(r"\s*(\S+) \(.*\) => (\S+)", line)) and (platform.machine() != "x86_64" or "x86-64" in line):
            places.setdefault(match.group(1), match.group(2))
    # A package may name a file by a folder that is a link today (/lib, /usr/lib).
    names: dict[str, set[str]] = {}
    for soname in sonames:
        if soname in places:
            paths = {places[soname], os.path.realpath(places[soname])}
            names[soname] = paths | {path[4:] for path in paths if path.startswith("/usr/")} | {"/usr" + path for path in paths}
    every = sorted(set().union(*names.values())) if names else []
    package_of = {}
    for line in output_of("dpkg-query", "-S", *every).splitlines() if every else []:
        if not line.startswith("diversion"):
            package, path = line.split(": ", 1)
            package_of[path] = package.split(",")[0].split(":")[0]
    return {soname: package_of[path] for soname, paths in names.items() for path in sorted(paths) if path in package_of}


def timestamp() -> str | None:
    seconds = os.environ.get("SOURCE_DATE_EPOCH") or output_of("git", "-C", str(ROOT), "log", "-1", "--format=%ct").strip()
    return datetime.fromtimestamp(int(seconds), timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ") if seconds else None


def bill(main: dict, components: list[dict]) -> str:
    components = sorted(components, key=lambda component: component["bom-ref"])
    metadata: dict = {"tools": {"components": [{"type": "application", "name": "make_sbom.py"}]}, "component": main}
    if time := timestamp():
        metadata = {"timestamp": time, **metadata}
    document: dict = {"bomFormat": "CycloneDX", "specVersion": "1.5", "serialNumber": "", "version": 1, "metadata": metadata, "components": components}
    document["dependencies"] = [
        {"ref": main["bom-ref"], "dependsOn": [component["bom-ref"] for component in components]},
        *({"ref": component["bom-ref"], "dependsOn": []} for component in components),
    ]
    document["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(document, sort_keys=True))}"
    return json.dumps(document, indent=2) + "\n"


def compiled_in(kind: str) -> list[dict]:
    return [debian_component(package, row, "compiled in", []) for package, row in installed(COMPILED_IN[kind]).items()]


def of_program(arguments: argparse.Namespace) -> None:
    program = Path(arguments.file)
    needed = needed_libraries(program)
    if not needed:
        fail(f"{program} asks for no library; give a program that is linked dynamically")
    owner = owners(needed)
    by_package: dict[str, list[dict]] = {}
    components = []
    for soname in needed:
        if soname in owner:
            by_package.setdefault(owner[soname], []).append(file_component(soname, None))
        else:
            unknown.append(f"no package has {soname}")
            components.append({"type": "library", "bom-ref": f"file:{soname}", "name": soname})
    rows = installed(sorted(by_package))
    components += [debian_component(package, rows[package], "shared", files) for package, files in by_package.items()]
    purl = f"pkg:generic/earshot@{quote(arguments.version, safe='')}"
    main = {"type": "application", "bom-ref": purl, "name": "earshot", "version": arguments.version}
    main |= {"licenses": [{"expression": "Apache-2.0"}], "purl": purl}
    Path(arguments.output).write_text(bill(main, components + compiled_in("program")))


def of_wheel(arguments: argparse.Namespace) -> None:
    tree = Path(arguments.tree)
    info = next(tree.glob("*.dist-info"))
    name, version = (re.search(rf"^{field}: (.*)$", (info / "METADATA").read_text(), re.MULTILINE).group(1) for field in ("Name", "Version"))  # type: ignore[union-attr]
    by_package: dict[str, list[dict]] = {}
    for line in Path(arguments.list).read_text().splitlines():
        file, package = line.split()
        by_package.setdefault(package, []).append(file_component(file, next(tree.rglob(file))))
    rows = installed(sorted(by_package))
    components = []
    for package, files in by_package.items():
        if package not in rows:
            fail(f"{package} is not installed")
        components.append(debian_component(package, rows[package], "shared", files))
    components += compiled_in("wheel")
    if arguments.nanobind:
        purl = f"pkg:pypi/nanobind@{arguments.nanobind}"
        component = {"type": "library", "bom-ref": purl, "name": "nanobind", "version": arguments.nanobind, "licenses": [{"expression": "BSD-3-Clause"}]}
        components.append({**component, "purl": purl, "properties": [{"name": "earshot:linkage", "value": "compiled in"}]})
    purl = f"pkg:pypi/{name}@{version}"
    main = {"type": "library", "bom-ref": purl, "name": name, "version": version, "licenses": [{"expression": "Apache-2.0"}], "purl": purl}
    folder = info / "sboms"
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.cdx.json").write_text(bill(main, components))


def licences_of(arguments: argparse.Namespace) -> None:
    licences = known_licences()
    for package, row in installed(arguments.package).items():
        if expression := licence_of(package, row["source"], licences):
            print(package, expression)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    program = commands.add_parser("program")
    program.add_argument("file")
    program.add_argument("--version", required=True)
    program.add_argument("--strict", action="store_true")
    program.add_argument("-o", "--output", required=True)
    program.set_defaults(call=of_program)
    wheel = commands.add_parser("wheel")
    wheel.add_argument("list")
    wheel.add_argument("tree")
    wheel.add_argument("--nanobind")
    wheel.set_defaults(call=of_wheel, strict=True)
    licence = commands.add_parser("licence")
    licence.add_argument("package", nargs="+")
    licence.set_defaults(call=licences_of, strict=True)
    arguments = parser.parse_args()
    arguments.call(arguments)
    for line in dict.fromkeys(unknown):
        print(f"make_sbom: {'' if arguments.strict else 'warning: '}{line}", file=sys.stderr)
    sys.exit(1 if unknown and arguments.strict else 0)


if __name__ == "__main__":
    main()
