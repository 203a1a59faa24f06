#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""check_wheel_versions.py WHEEL...: is each library that a wheel ships as new as the newest one that apt offers, Debian's security suite included?

Prints a line per library with its package, the version in the wheel and the newest one.  Reads the bill of materials inside the wheel, and what
`apt-get update` last fetched.  Status 1 where a library is older; 2 where apt has no security suite, or the wheel was built on another release of Debian.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from urllib.parse import unquote


def fail(text: str) -> None:
    print(f"check_wheel_versions: {text}", file=sys.stderr)
    sys.exit(2)


def output_of(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def bill_of(wheel: str) -> dict:
    if not zipfile.is_zipfile(wheel):
        fail(f"{wheel} is no wheel; scripts/build_wheel.sh makes one in build/wheel")
    with zipfile.ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if re.search(r"\.dist-info/sboms/.*\.cdx\.json$", name)]
        if not names:
            fail(f"{wheel} has no bill of materials; build it again with scripts/build_wheel.sh")
        return json.loads(archive.read(names[0]))


def is_newer(version: str, than: str) -> bool:
    return subprocess.run(["dpkg", "--compare-versions", version, "gt", than], check=False).returncode == 0


def newest_offered(package: str) -> str | None:
    newest = None
    for line in output_of("apt-cache", "madison", package).splitlines():
        version = line.split("|")[1].strip()
        if newest is None or is_newer(version, newest):
            newest = version
    return newest


def check(wheel: str) -> bool:
    system = output_of("sh", "-c", '. /etc/os-release; echo "$ID-$VERSION_ID"').strip()
    rows = []
    for component in bill_of(wheel)["components"]:
        if match := re.fullmatch(r"pkg:deb/\w+/([^@]+)@([^?]+)\?arch=\w+&distro=(\S+)", component["purl"]):
            package, version, built_on = (unquote(part) for part in match.groups())
            if built_on != system:
                fail(f"{wheel} was built on {built_on}, and this machine is {system}: run it on {built_on}")
            rows.append((package, version, [file["name"] for file in component.get("components", [])]))
    if not rows:
        fail(f"{wheel} names no package of Debian in its bill of materials")
    passed = True
    print(Path(wheel).name)
    for package, version, files in rows:
        newest = newest_offered(package)
        if newest is None:
            state, passed = "NOT OFFERED", False
        elif is_newer(newest, version):
            state, passed = "OLDER", False
        else:
            state = "current"
        print(f"  {package:24} {version:32} newest {newest or '-':32} {state:12} {' '.join(files) or 'compiled in'}")
    return passed


def main() -> None:
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        print(__doc__, file=sys.stderr if len(sys.argv) < 2 else sys.stdout)
        sys.exit(2 if len(sys.argv) < 2 else 0)
    suites = output_of("apt-get", "indextargets", "--format", "$(RELEASE)", "Created-By: Packages").split()
    if not any(suite.endswith("-security") for suite in suites):
        fail("apt has no source of Debian's security suite; add one and run apt-get update")
    # Every wheel is checked, whichever fails.
    results = [check(wheel) for wheel in sys.argv[1:]]
    if not all(results):
        print("check_wheel_versions: older than what Debian offers: apt-get upgrade, then build the wheel again", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
