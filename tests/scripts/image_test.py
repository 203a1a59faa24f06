# SPDX-License-Identifier: Apache-2.0
"""image_test.py SOURCES: do the Dockerfile, the scripts that it runs and .dockerignore agree?

The Dockerfile is read as docker reads it, line by line; scripts/check_image.sh runs its last stage without a container engine.
"""

import os
import re
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path

sources = Path(sys.argv[1])
failures: list[str] = []


def expect(holds: bool, text: str) -> None:
    if not holds:
        failures.append(text)


lines = [line for line in (sources / "Dockerfile").read_text().replace("\\\n", " ").splitlines() if line and not line.startswith("#")]
stages: list[list[tuple[str, str]]] = []
for line in lines:
    word, _, rest = line.partition(" ")
    if word == "FROM":
        stages.append([])
    expect(bool(stages), f"'{line}' stands before the first FROM")
    stages[-1].append((word, rest.strip()))

expect(len(stages) == 2, f"{len(stages)} stages in place of two")
bases = [stage[0][1] for stage in stages]
expect(bases[0] == "debian:trixie-slim AS build", f"the first stage is FROM {bases[0]}")
expect(bases[-1] == "debian:trixie-slim", f"the last stage is FROM {bases[-1]}")

ignored = [rule.strip() for rule in (sources / ".dockerignore").read_text().splitlines() if rule.strip() and not rule.startswith("#")]
tracked = subprocess.run(["git", "-C", sources, "ls-files"], capture_output=True, text=True, check=True).stdout.split("\n")


def is_ignored(path: str) -> bool:
    parts = path.split("/")
    return any(
        fnmatch("/".join(parts[i:n]), rule.removeprefix("**/"))
        for rule in ignored
        for n in range(1, len(parts) + 1)
        for i in (range(n) if rule.startswith("**/") else (0,))
    )


lost = [path for path in tracked if path and is_ignored(path)]
expect(not lost, f".dockerignore leaves tracked files out: {lost[:3]}")

names = {base.partition(" AS ")[2] for base in bases} - {""}
copied: dict[int, set[str]] = {}
for number, stage in enumerate(stages):
    copied[number] = set()
    for word, rest in stage:
        if word != "COPY":
            continue
        options = [part for part in rest.split() if part.startswith("--")]
        *paths, target = [part for part in rest.split() if not part.startswith("--")]
        for option in options:
            expect(option.startswith("--from=") and option.removeprefix("--from=") in names, f"COPY {rest}: no such stage")
        if not options:
            for path in paths:
                expect((sources / path).exists(), f"COPY {rest}: there is no {path}")
                copied[number].add(path if target == "." else target.rstrip("/") + "/" + Path(path).name)

# Each RUN is one script of scripts/ with arguments: nothing is done in the image that check_image.sh would not run.
for number, stage in enumerate(stages):
    runs = [rest for word, rest in stage if word == "RUN"]
    expect(len(runs) == 1, f"stage {number} has {len(runs)} RUN lines in place of one")
    for run in runs:
        program, *arguments = run.split()
        expect(not re.search(r"[;&|<>$`]", run), f"RUN {run}: more than one script")
        script = sources / "scripts" / Path(program).name
        expect(script.is_file() and os.access(script, os.X_OK), f"RUN {run}: scripts/{Path(program).name} is no program")
        expect(program in copied[number] or "." in copied[number], f"RUN {run}: {program} was not copied into this stage")
        if script.is_file():
            expect(subprocess.run(["bash", "-n", script], check=False).returncode == 0, f"{script.name} is no bash script")
            outcome = subprocess.run(["bash", script], capture_output=True, text=True, check=False)
            expect(outcome.returncode == 2, f"{script.name} without arguments ends with {outcome.returncode}")
            expect(len(arguments) == 1, f"RUN {run}: {script.name} takes one folder")

last = stages[-1]
build_run, runtime_run = ([rest for word, rest in stage if word == "RUN"][0].split() for stage in stages)
from_build = [rest.split() for word, rest in last if word == "COPY" and "--from=build" in rest]
expect(from_build == [["--from=build", build_run[1], runtime_run[1]]], f"the .deb of {build_run[1]} does not reach {runtime_run[1]}: {from_build}")
users = [rest for word, rest in last if word == "USER"]
expect(len(users) == 1 and users[0] not in ("root", "0"), f"users of the last stage: {users}")
runtime = (sources / "scripts" / Path(runtime_run[0]).name).read_text()
expect(bool(users) and re.search(rf"^useradd .* {re.escape(users[0])}$", runtime, re.M) is not None, f"{runtime_run[0]} adds no user {users}")
order = [word for word, _ in last]
expect("USER" in order and order.index("USER") > order.index("RUN"), "USER stands before the step that installs")
expect(("ENTRYPOINT", '["earshot"]') in last, "the entry is not earshot")
home = [rest for word, rest in last if word == "WORKDIR"]
expect(bool(users) and home == [f"/home/{users[0]}"], f"the working folder is {home}")

for failure in failures:
    print("image_test:", failure)
sys.exit(bool(failures))
