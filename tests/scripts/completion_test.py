# SPDX-License-Identifier: Apache-2.0
"""completion_test.py PROGRAM: do completion for bash and zsh and the manual page hold all that --help shows?

Commands and flags are read from the help of each command, so that what the three outputs leave out shows.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

program = str(Path(sys.argv[1]).resolve())
failures: list[str] = []
skipped: list[str] = []


def expect(holds: bool, text: str) -> None:
    if not holds:
        failures.append(text)


def run(*arguments: str) -> str:
    return subprocess.run([program, *arguments], capture_output=True, text=True, check=True).stdout


def read_help(words: tuple[str, ...]) -> tuple[list[str], list[str]]:
    """Sub-commands and flags of one command, as its help lists them: a line of a section begins with two spaces and the name."""
    commands: list[str] = []
    flags: list[str] = []
    section = ""
    for line in run(*words, "--help").splitlines():
        if re.match(r"^[A-Z][A-Za-z ]*:$", line):
            section = line.rstrip(":")
        elif not line:
            section = ""
        elif section and (name := re.match(r"^  (\S+)", line)):
            if section == "Subcommands":
                commands.append(name[1])
            elif name[1].startswith("-"):
                flags += [flag for flag in re.split(r"[, ]+", name[1]) if flag.startswith("-")]
    return commands, [flag.split("=")[0] for flag in flags]


with ThreadPoolExecutor(4) as pool:
    bash, zsh, man = pool.map(lambda kind: run("completion", kind), ("bash", "zsh", "man"))
    found: dict[tuple[str, ...], tuple[list[str], list[str]]] = {}
    level: list[tuple[str, ...]] = [()]
    while level:
        found |= dict(zip(level, pool.map(read_help, level), strict=True))
        level = [(*words, name) for words in level for name in found[words][0]]
num_flags = sum(len(flags) for _, flags in found.values())
expect(len(found) > 30 and num_flags > 250, f"the help names {len(found)} commands and {num_flags} flags: too few, it was not read")

# bash: what the sourced script offers, per command, in one shell.
questions = ["source <(cat); ask() { COMP_WORDS=(\"$@\"); COMP_CWORD=$(($# - 1)); COMPREPLY=(); _earshot; echo ${COMPREPLY[@]}; }"]
asked: list[tuple[str, set[str]]] = []
for words, (commands, flags) in found.items():
    before = " ".join(("earshot", *words))
    if commands:
        questions.append(f"ask {before} ''")
        asked.append((before, set(commands)))
    questions.append(f"ask {before} -")
    asked.append((before, set(flags)))
questions += ["ask earshot ri", "ask earshot rir --sour", "ask earshot dataset ri"]
with tempfile.TemporaryDirectory() as folder:
    script = Path(folder) / "earshot.bash"
    script.write_text(bash)
    checked = subprocess.run(["bash", "-n", script], capture_output=True, text=True, check=False)
    expect(checked.returncode == 0 and not checked.stderr, f"bash -n: {checked.stderr}")
    shell = subprocess.run(["bash", "-c", "\n".join(questions)], input=bash, capture_output=True, text=True, check=False)
    expect(shell.returncode == 0 and not shell.stderr, f"bash: {shell.stderr}")
    answers = shell.stdout.splitlines()
    expect(len(answers) == len(asked) + 3, f"bash answers {len(answers)} of {len(asked) + 3} questions")
    for (before, wanted), answer in zip(asked, answers, strict=False):
        expect(wanted <= set(answer.split()), f"bash: {before} does not offer {sorted(wanted - set(answer.split()))}")
    expect(answers[-3:-2] == ["rir"], f"bash: earshot ri<TAB> gives {answers[-3:-2]}")
    expect("--source" in " ".join(answers[-2:-1]).split(), f"bash: earshot rir --sour<TAB> gives {answers[-2:-1]}")
    expect(answers[-1:] == ["rir"], f"bash: earshot dataset ri<TAB> gives {answers[-1:]}")

    # zsh: the function of each command has its flags and the words of its sub-commands.
    functions = {name: body for name, body in re.findall(r"^(_earshot\w*)\(\) \{\n(.*?)^\}$", zsh, re.M | re.S)}
    for words, (commands, flags) in found.items():
        name = "_".join(("_earshot", *words))
        body = functions.get(name, "")
        expect(bool(body), f"zsh: no function {name}")
        for flag in flags:
            expect(f"'*{flag}[" in body, f"zsh: {name} lacks {flag}")
        for command in commands:
            expect(f"        '{command}:" in body and f"{command}) {name}_{command} ;;" in body, f"zsh: {name} lacks {command}")
    expect(zsh.startswith("#compdef earshot\n"), "zsh: the first line is not #compdef earshot")
    if shutil.which("zsh"):
        file = Path(folder) / "_earshot"
        file.write_text(zsh)
        checked = subprocess.run(["zsh", "-n", file], capture_output=True, text=True, check=False)
        expect(checked.returncode == 0 and not checked.stderr, f"zsh -n: {checked.stderr}")
    else:
        skipped.append("zsh is not installed: the script is not parsed")

    # The manual page: a section per command with its flags; --help is described once.
    plain = man.replace("\\-", "-")
    sections = dict(re.findall(r'^\.SS "earshot ([^"]*)"\n(.*?)(?=^\.S[SH] |\Z)', plain, re.M | re.S))
    sections[""] = dict(re.findall(r"^\.SH (\w+)\n(.*?)(?=^\.SH |\Z)", plain, re.M | re.S)).get("OPTIONS", "")
    for words, (_, flags) in found.items():
        name = " ".join(words)
        expect(name in sections, f"man: no section of '{name}'")
        shown = {flag for line in re.findall(r"^\.B (.*)$", sections.get(name, ""), re.M) for flag in re.split(r"[, ]+", line)}
        missing = {flag for flag in flags if flag not in shown and (not words or flag not in ("-h", "--help"))}
        expect(not missing, f"man: '{name}' lacks {sorted(missing)}")
    page = Path(folder) / "earshot.1"
    page.write_text(man)
    for tool in (["man", "--warnings", "-E", "UTF-8", "-l", "-Tutf8"], ["groff", "-man", "-Tutf8", "-ww"]):
        if not shutil.which(tool[0]):
            skipped.append(f"{tool[0]} is not installed")
            continue
        checked = subprocess.run([*tool, page], capture_output=True, text=True, check=False, env={"PATH": "/usr/bin:/bin", "MANWIDTH": "80", "LC_ALL": "C.UTF-8"})
        expect(checked.returncode == 0 and not checked.stderr, f"{tool[0]}: {checked.stderr[:300]}")
        expect("--source" in re.sub(r"\x1b\[[0-9;]*m|.\x08", "", checked.stdout), f"{tool[0]} shows no --source")

print(f"completion_test: {len(found)} commands, {num_flags} flags" + "".join(f"; skipped: {reason}" for reason in skipped))
for failure in failures:
    print("completion_test:", failure)
sys.exit(bool(failures))
