#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""sbom_test.py PROJECT PROGRAM: the bill of materials of a program, that of a wheel, and the comparison of a wheel's libraries with Debian's.

Ends with 77 (skipped) where dpkg is not the package manager.  Held to the official schema where the Python packages cyclonedx-python-lib and jsonschema
are installed; to the fields that it requires in any case.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

failures = 0


def expect(condition: bool, text: str) -> None:
    global failures
    if not condition:
        print(f"sbom_test: {text}")
        failures += 1


def run(*command: object, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(word) for word in command], env={**os.environ, **(env or {})}, capture_output=True, text=True, check=False)


def check_fields(bill: dict, what: str) -> None:
    expect(bill["bomFormat"] == "CycloneDX" and bill["specVersion"] == "1.5" and bill["version"] == 1, f"{what}: head")
    expect(re.fullmatch(r"urn:uuid:[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", bill["serialNumber"]) is not None, f"{what}: serialNumber")
    references = [component["bom-ref"] for component in bill["components"]]
    expect(len(set(references)) == len(references) > 2, f"{what}: bom-ref are not unique")
    for component in bill["components"]:
        for field in ("type", "name", "version", "licenses", "purl"):
            expect(bool(component.get(field)), f"{what}: {component['name']} has no {field}")
        expect(re.match(r"pkg:(deb/\w+|pypi)/[^@:+ ]+@[^@:+ ]+(\?|$)", component["purl"]) is not None, f"{what}: purl {component['purl']}")
    main = bill["metadata"]["component"]["bom-ref"]
    edges = {edge["ref"]: edge["dependsOn"] for edge in bill["dependencies"]}
    expect(sorted(edges[main]) == sorted(references), f"{what}: {main} does not depend on each component")


def check_schema(bill: dict, what: str) -> None:
    if importlib.util.find_spec("cyclonedx") is None or importlib.util.find_spec("jsonschema") is None:
        print(f"sbom_test: {what}: not held to the official schema (cyclonedx-python-lib and jsonschema are not installed)")
        return
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator

    error = JsonStrictValidator(SchemaVersion.V1_5).validate_str(json.dumps(bill))
    expect(error is None, f"{what}: {error}")
    print(f"sbom_test: {what}: held to the official schema")


def main() -> int:
    project, program = Path(sys.argv[1]), Path(sys.argv[2])
    if shutil.which("dpkg-query") is None:
        print("sbom_test: skipped: no dpkg")
        return 77
    script = project / "scripts" / "make_sbom.py"
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)

        # A program: the same bytes twice; each library that it asks for has a package.
        files = [root / "first.json", root / "second.json"]
        for file in files:
            done = run(sys.executable, script, "program", program, "--version", "1.2.3", "--strict", "-o", file, env={"SOURCE_DATE_EPOCH": "1700000000"})
            expect(done.returncode == 0, f"program: status {done.returncode}: {done.stderr}")
        expect(files[0].read_bytes() == files[1].read_bytes(), "program: two runs differ")
        bill = json.loads(files[0].read_text())
        check_fields(bill, "program")
        check_schema(bill, "program")
        expect(bill["metadata"]["timestamp"] == "2023-11-14T22:13:20Z", "program: the time is not SOURCE_DATE_EPOCH")
        listed = {file["name"]: component for component in bill["components"] for file in component.get("components", [])}
        needed = re.findall(r"\(NEEDED\).*\[(.*)\]", run("readelf", "-d", program, env={"LC_ALL": "C"}).stdout)
        expect(len(needed) > 3, "program: readelf lists no libraries")
        for library in needed:
            expect(library in listed, f"program: no package has {library}")
        for library in needed:
            if library in listed:
                version = run("dpkg-query", "-W", "-f", "${Version}", listed[library]["name"]).stdout
                expect(listed[library]["version"] == version, f"program: {library}: version {listed[library]['version']}, installed {version}")

        # A licence that is not known.
        copy = root / "tree" / "scripts"
        copy.mkdir(parents=True)
        shutil.copy(script, copy)
        licences = (project / "scripts" / "library_licences.txt").read_text()
        (copy / "library_licences.txt").write_text(re.sub(r"^glibc .*\n", "", licences, flags=re.MULTILINE))
        command = [sys.executable, copy / "make_sbom.py", "program", program, "--version", "1.2.3", "-o", root / "third.json"]
        expect("has no licence of glibc" in run(*command, "--strict").stderr, "no word of a licence that is not known")
        expect(run(*command, "--strict").returncode == 1, "strict takes a licence that is not known")
        expect(run(*command).returncode == 0, "a licence that is not known is no warning")

        # A wheel.
        tree = root / "wheel"
        info = tree / "earshot_rl-1.2.3.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text("Metadata-Version: 2.2\nName: earshot-rl\nVersion: 1.2.3\n")
        (tree / "earshot_rl.libs").mkdir()
        (tree / "earshot_rl.libs" / "libz-0123abcd.so.1").write_bytes(b"a library")
        (root / "list").write_text("libz-0123abcd.so.1 zlib1g\n")
        done = run(sys.executable, script, "wheel", root / "list", tree, "--nanobind", "3.1.0")
        expect(done.returncode == 0, f"wheel: status {done.returncode}: {done.stderr}")
        bill_file = info / "sboms" / "earshot-rl.cdx.json"
        bill = json.loads(bill_file.read_text())
        check_fields(bill, "wheel")
        check_schema(bill, "wheel")
        zlib = next(component for component in bill["components"] if component["name"] == "zlib1g")
        expect(zlib["components"][0]["name"] == "libz-0123abcd.so.1" and len(zlib["components"][0]["hashes"][0]["content"]) == 64, "wheel: file")

        # What apt offers, played by scripts.
        wheel = root / "earshot_rl-1.2.3-cp312-abi3-linux_x86_64.whl"
        with zipfile.ZipFile(wheel, "w") as archive:
            archive.write(bill_file, f"{info.name}/sboms/{bill_file.name}")
        tools = root / "bin"
        tools.mkdir()

        def offer(newer: str, suite: str) -> subprocess.CompletedProcess[str]:
            lines = []
            for component in bill["components"]:
                version = component["version"] + ("+deb99u1" if component["name"] == newer else "")
                lines += [f"{component['name']} | 0.1-1 | a mirror", f"{component['name']} | {version} | a mirror"]
            (root / "offered").write_text("\n".join(lines) + "\n")
            (tools / "apt-cache").write_text(f'#!/bin/sh\ngrep "^$2 " "{root}/offered"\n')
            (tools / "apt-get").write_text(f"#!/bin/sh\necho {suite}\n")
            for tool in tools.iterdir():
                tool.chmod(0o755)
            return run(sys.executable, project / "scripts" / "check_wheel_versions.py", wheel, env={"PATH": f"{tools}:{os.environ['PATH']}"})

        done = offer("none", "stable-security")
        expect(done.returncode == 0 and done.stdout.count(" current ") == len(bill["components"]) - 1, f"versions: {done.stdout}{done.stderr}")
        done = offer("zlib1g", "stable-security")
        expect(done.returncode == 1 and re.search(r"zlib1g .*OLDER", done.stdout) is not None, f"versions, an older one: {done.stdout}{done.stderr}")
        done = offer("none", "stable")
        expect(done.returncode == 2 and "security suite" in done.stderr, f"versions, no security suite: {done.stdout}{done.stderr}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
