# SPDX-License-Identifier: Apache-2.0
"""citation_test.py FILE: is a CITATION.cff valid?  By cffconvert where it is installed, and by the keys that every file of version 1.2.0 must have."""

import importlib.util
import re
import subprocess
import sys

text = open(sys.argv[1], encoding="utf-8").read()
failures = []
values = dict(re.findall(r"^([a-z-]+): *(.*)$", text, re.M))
for key in ("cff-version", "message", "title", "authors", "version", "date-released", "license", "type"):
    if key not in values:
        failures.append(f"the key {key} is missing")
if values.get("cff-version") != "1.2.0":
    failures.append(f"cff-version is {values.get('cff-version')}")
if values.get("type") not in ("software", "dataset"):
    failures.append(f"type is {values.get('type')}")
if not re.search(r"^authors:\n  - (name|family-names|given-names): \S", text, re.M):
    failures.append("authors has no entry with a name")
if not re.fullmatch(r'"?\d{4}-\d{2}-\d{2}"?', values.get("date-released", "")):
    failures.append("date-released is no date YYYY-MM-DD")
if importlib.util.find_spec("cffconvert"):
    outcome = subprocess.run([sys.executable, "-m", "cffconvert.cli.cli", "--validate", "-i", sys.argv[1]], capture_output=True, text=True, check=False)
    if outcome.returncode != 0:
        failures.append("cffconvert: " + (outcome.stdout + outcome.stderr).strip()[-300:])
else:
    print("citation_test: skipped: cffconvert is not installed; the keys alone were checked")
for failure in failures:
    print("citation_test:", failure)
sys.exit(bool(failures))
