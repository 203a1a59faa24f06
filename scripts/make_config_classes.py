#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""make_config_classes.py [--check] PROGRAM: writes the dataclasses of python/earshot/config from the keys that `PROGRAM config --json` prints.

--check: writes nothing; status 1 if a file differs.  Sections with equal keys are one class, a choice is a Literal, and a key whose default depends on
other keys or on files is None.  A section whose presence switches something on is None, and an instance of it switches that on.
"""

from __future__ import annotations

import ast
import difflib
import json
import keyword
import re
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "python/earshot/config"
#: By module: what it holds, and its classes with the kind of config and the section that each is made of.
MODULES = {
    "acoustics": (
        "Simulation of responses.",
        {"Acoustics": ("environment config", "acoustics"), "CorpusAcoustics": ("response corpus", "acoustics")},
    ),
    "envs": ("Configs of environments.", {"EnvConfig": ("environment config", "")}),
    "runs": ("Configs of training runs.", {"RunConfig": ("run config", "")}),
    "corpora": (
        "Configs of corpora.",
        {"ResponseCorpusConfig": ("response corpus", ""), "RecordingCorpusConfig": ("recording corpus", "")},
    ),
    "scenes": ("Configs of scenes.", {"SceneConfig": ("scene", "")}),
}
#: Names of sections that several files or keys share; others have the name of their last key.
NAMES = {"data.train": "TrainingEpisodes", "data.eval": "Episodes", "data.held_out": "Episodes", "cameras": "MountedCamera"}
#: Keys that follow another key, the run or the caller where they are left out.
DEPENDENT = {"out", "env.seed", "policy.seed", "env.autoreset", "autoreset", "env.threads", "threads"}
#: Keys that follow a file where they are left out, with what their description does not say of that.
OF_FILES = {
    "up": " Absent: y, or z for a LAS file.",
    "unit_m": " Absent: 1, with a warning where the sizes tell otherwise.",
    "coefficients": "",
}
#: Sections that the engine reads as switches: {} is on.
OPTIONAL = {"randomize", "panorama"}
TYPES = {
    "number": "float",
    "whole number": "int",
    "true or false": "bool",
    "text": "str",
    "list of text": "list[str]",
    "list of numbers": "list[float]",
    "list of whole numbers": "list[int]",
    "text or list": "str | list[str]",
}
BASE = "# SPDX-License-Identifier: Apache-2.0\n"


class Module:
    """The text of one module: its classes in the order in which they refer to each other."""

    def __init__(self, about: str, classes: dict[str, tuple[str, list[str]]]) -> None:
        self.about = about
        self.classes = classes  #: Of all modules: by name the module's purpose and the fields without their descriptions.
        self.imported: set[str] = set()
        self.choices: dict[str, str] = {}
        self.bodies: dict[str, str] = {}  # by class
        self.kind = ""  # the class of the file under way

    def class_of(self, path: str, about: str, keys: list[dict[str, Any]], wanted: str) -> str:
        """The name of a class with these keys (all below `path`), which is added unless an equal one is there."""
        start = len(path) + 1 if path else 0
        inside = [{**key, "name": key["key"][start:]} for key in keys if key["key"] != path]
        follows_preset = any(key["name"] == "preset" for key in inside)
        fields = []
        for key in inside:
            if "." in key["name"]:
                continue
            below = [one for one in inside if one["name"].startswith(key["name"] + ".")]
            fields.append(self.section(key, below) if key["type"] == "section" else self.value(key, follows_preset))
        signature = [one.splitlines()[-1] for one in fields]
        for name, (module, other) in self.classes.items():
            if other == signature and name.endswith(wanted):
                if module != self.about:
                    self.imported.add(name)
                return name
        name = wanted if wanted not in self.classes else self.kind.removesuffix("Config") + wanted
        if name in self.classes:
            raise SystemExit(f"make_config_classes: {path} needs a name in NAMES: there is another {name}")
        self.classes[name] = (self.about, signature)
        self.bodies[name] = f'    """{general(about)}"""\n\n' + "".join(fields)
        return name

    def section(self, key: dict[str, Any], below: list[dict[str, Any]]) -> str:
        name, path = key["name"], key["key"]
        named = [one for one in below if one["name"].startswith(f"{name}.") and one["name"].split(".")[1].isupper()]
        if named and named[0]["type"] != "section":
            return field(name, f"dict[str, {self.loose(TYPES[named[0]['type']])}]", "dataclasses.field(default_factory=dict)", key["about"])
        if named:
            one = self.class_of(f"{path}.{named[0]['name'].split('.')[1]}", named[0]["about"], named, NAMES[name])
            return field(name, f"dict[str, {one}]", "dataclasses.field(default_factory=dict)", key["about"])
        one = self.class_of(path, key["about"], below, NAMES.get(path, class_name(name)))
        if path in OPTIONAL:
            return field(name, f"{one} | None", "None", key["about"])
        return field(name, one, f"dataclasses.field(default_factory={one})", key["about"])

    def value(self, key: dict[str, Any], follows_preset: bool) -> str:
        kind, name, default = key["type"], key["name"], key.get("default")
        annotation = self.choice(key["choices"]) if kind == "choice" else TYPES[kind]
        if re.search(r"or [a-z_]+$", key["range"]) and kind == "number":
            annotation = "float | str"
        about = key["about"] + (f" Range: {key['range']}." if key["range"] and kind != "choice" and kind != "true or false" else "")
        if follows_preset and default is not None and name != "preset":
            about += f" Without a preset: {default}."
        if key["required"]:
            return field(name, annotation, "", about)
        about += OF_FILES.get(key["key"], "")
        if default is None or key["key"] in DEPENDENT | OF_FILES.keys() or "Without a preset" in about:
            return field(name, f"{annotation} | None", "None", about)
        if kind.startswith("list"):
            value: list[Any] = ast.literal_eval(default) if "numbers" in kind else [part for part in default.strip("[]").split(", ") if part]
            value = [float(one) for one in value] if kind == "list of numbers" else value  # as OmegaConf makes them
            return field(name, annotation, f"dataclasses.field(default_factory=lambda: {json.dumps(value)})" if value else LIST, about)
        return field(name, annotation, literal(kind, default), about)

    def choice(self, choices: list[str]) -> str:
        name = "".join(class_name(choice) for choice in choices)
        self.choices[name] = f"Literal[{', '.join(json.dumps(choice) for choice in choices)}]"
        return name

    def loose(self, annotation: str) -> str:
        """A type of the values of a dict, where OmegaConf has no unions of lists."""
        if "|" not in annotation:
            return annotation
        name = "TextOrList"
        self.choices[name] = annotation
        return name

    def text(self, modules: dict[str, str]) -> str:
        """modules: by purpose the names of the modules."""
        sources: dict[str, list[str]] = {"._section": ["Section"]}
        said = "".join(self.bodies.values())
        used = {name: values for name, values in self.choices.items() if re.search(rf"\b{name}\b", said)}
        for name in sorted(name for name in self.imported if re.search(rf"\b{name}\b", said)):
            sources.setdefault(modules[self.classes[name][0]], []).append(name)
        typing = ["TYPE_CHECKING", *(["Any"] if "TextOrList" in used else []), "Literal"]
        imports = "import dataclasses\n" + (f"from typing import {', '.join(typing)}\n" if used else "")
        local = "".join(f"from .{module} import {', '.join(names)}\n" for module, names in sorted(sources.items()))
        choices = ""
        if used:
            choices = "if TYPE_CHECKING:\n" + "".join(f"    {name} = {values}\n" for name, values in sorted(used.items()))
            runtime = {name: "str" if value.startswith("Literal") else "Any" for name, value in used.items()}
            choices += "else:  # OmegaConf 2.3 knows no Literal and no unions of lists\n"
            choices += "".join(f"    {name} = {runtime[name]}\n" for name in sorted(used)) + "\n"
        classes = [
            f"@dataclasses.dataclass(kw_only=True, slots=True)\nclass {name}(Section):\n{body}" for name, body in self.bodies.items()
        ]
        about = f'"""{self.about}  Made by scripts/make_config_classes.py from `earshot config --json`."""\n\n'
        return f"{BASE}{about}from __future__ import annotations\n\n{imports}\n{local}\n{choices}\n" + "\n\n".join(classes)


LIST = "dataclasses.field(default_factory=list)"


def class_name(key: str) -> str:
    return "".join(part.capitalize() for part in re.split(r"[_.]", key))


def general(about: str) -> str:
    return about[0].upper() + about[1:]


def literal(kind: str, default: str) -> str:
    if kind == "true or false":
        return default.capitalize()
    if kind in ("text", "choice"):
        return json.dumps(json.loads(default) if default.startswith('"') else default)
    return repr(float(default) if kind == "number" else int(default))


def field(name: str, annotation: str, default: str, about: str) -> str:
    """A field with its description before it, wrapped."""
    lines = textwrap.wrap(about, 132, initial_indent="    #: ", subsequent_indent="    #: ")
    safe = name + "_" if keyword.iskeyword(name) else name
    return "\n".join(lines) + f"\n    {safe}: {annotation}" + (f" = {default}" if default else "") + "\n"


def modules_of(kinds: list[dict[str, Any]]) -> dict[str, str]:
    by_name = {kind["kind"]: kind for kind in kinds}
    classes: dict[str, tuple[str, list[str]]] = {}
    texts = {}
    for module, (about, wanted) in MODULES.items():
        text = Module(about, classes)
        for name, (kind, path) in wanted.items():
            text.kind = name
            keys = [key for key in by_name[kind]["keys"] if not path or key["key"].startswith(path + ".")]
            section = [key for key in by_name[kind]["keys"] if key["key"] == path]
            text.class_of(path, (section or [by_name[kind]])[0]["about"], keys, name)
        texts[f"{module}.py"] = text.text({purpose: name for name, (purpose, _) in MODULES.items()})
    return texts


def main(arguments: list[str]) -> int:
    check = arguments[:1] == ["--check"]
    if len(arguments) != 1 + check:
        print(__doc__, file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        keys = Path(folder) / "keys.json"
        subprocess.run([arguments[-1], "config", "--json", str(keys)], check=True, stdout=subprocess.DEVNULL, timeout=120)
        texts = modules_of(json.loads(keys.read_text(encoding="utf-8"))["kinds"])
    different = 0
    for name, text in texts.items():
        path = FOLDER / name
        old = path.read_text(encoding="utf-8") if path.exists() else ""
        if old == text:
            continue
        different += 1
        if check:
            print("\n".join(list(difflib.unified_diff(old.splitlines(), text.splitlines(), name, "made from the keys", lineterm=""))[:20]))
            print(f"make_config_classes: python/earshot/config/{name} differs; run scripts/make_config_classes.py {arguments[-1]}")
        else:
            path.write_text(text, encoding="utf-8")
    return 1 if check and different else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
