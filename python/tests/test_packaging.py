# SPDX-License-Identifier: Apache-2.0
"""packaging/: the conda recipe has the facts of pyproject.toml and is read by rattler-build, the dataset card by huggingface_hub."""

from __future__ import annotations

import hashlib
import json
import os
import random
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

import earshot

ROOT = Path(__file__).resolve().parents[2]
URL = "https://example.org/earshot_rl.tar.gz"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SIZES = {1: "n<1K", 999: "n<1K", 1000: "1K<n<10K", 40_000: "10K<n<100K", 10**6: "1M<n<10M", 10**9: "100M<n<1B"}


def run(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "packaging" / script), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture
def recipe(tmp_path: Path) -> str:
    sdist = tmp_path / f"earshot_rl-{earshot.__version__}.tar.gz"
    sdist.write_bytes(b"sources")
    done = run("conda/make_recipe.py", "--sdist", str(sdist), "--url", URL, "--out", str(tmp_path / "recipe"))
    assert done.returncode == 0, done.stderr
    return (tmp_path / "recipe/recipe.yaml").read_text(encoding="utf-8")


def test_the_recipe_has_the_facts_of_the_project(recipe: str) -> None:
    assert f'version: "{earshot.__version__}"' in recipe
    assert f"sha256: {hashlib.sha256(b'sources').hexdigest()}" in recipe
    assert f"url: {URL}" in recipe
    assert "@" not in recipe
    lines = [line.strip().removeprefix("- ") for line in recipe.splitlines()]
    wanted = [*PROJECT["build-system"]["requires"], *PROJECT["project"]["dependencies"]]
    wanted += [PROJECT["project"]["optional-dependencies"][extra][0] for extra in ("gym", "agents")]
    for requirement in wanted:
        assert requirement.replace(">=", " >=") in lines
    assert f'match(python, "<{PROJECT["project"]["requires-python"].removeprefix(">=")}")' in lines
    assert f"license: {PROJECT['project']['license']['text']}" in lines


def test_rattler_build_renders_the_recipe(recipe: str) -> None:
    rattler = pytest.importorskip("rattler_build", reason="no py-rattler-build")
    variants = {"python": ["3.11", "3.12"], "c_compiler": ["gcc"], "cxx_compiler": ["gxx"], "c_stdlib": ["sysroot"]}
    rendered = rattler.Stage0Recipe.from_yaml(recipe).render(rattler.VariantConfig(variants))
    assert rendered
    for one in rendered:
        assert str(one.recipe.package.version) == earshot.__version__
        found = one.recipe.to_dict()
        assert "scikit-build-core >=0.10" in found["requirements"]["host"]
        assert len(found["tests"]) == 2
    with pytest.raises(rattler.RattlerBuildError):  # what it would say of a key that it does not know
        rattler.Stage0Recipe.from_yaml(recipe.replace("license_file:", "licence_file:")).render(rattler.VariantConfig(variants))


def test_a_wrong_sdist_is_an_error(tmp_path: Path) -> None:
    for name, words in (("none.tar.gz", "no such file"), ("earshot_rl-0.0.1.tar.gz", "is not of version")):
        if name != "none.tar.gz":
            (tmp_path / name).write_bytes(b"")
        done = run("conda/make_recipe.py", "--sdist", str(tmp_path / name), "--url", URL, "--out", str(tmp_path / "recipe"))
        assert done.returncode == 1
        assert words in done.stderr
        assert not (tmp_path / "recipe").exists()


def corpus_of(folder: Path, responses: int) -> Path:
    folder.mkdir()
    about = {"rooms": 7, "responses": responses, "engine": "abc Release", "channels": ["left", "right"], "sample_rate_hz": 16000.0}
    (folder / "corpus.json").write_text(json.dumps({**about, "bands_hz": [125.9, 251.2], "config": "seed: 1\nscenes:\n  []\n"}))
    (folder / "manifest.jsonl").write_text("")
    return folder


def card_of(folder: Path, name: str) -> Any:
    hub = pytest.importorskip("huggingface_hub", reason="no huggingface_hub")
    done = run("huggingface/make_card.py", str(folder), f"--name={name}", "--license", "cc-by-4.0")
    assert done.returncode == 0, done.stderr
    return hub.DatasetCard.load(folder / "README.md")


@pytest.mark.parametrize("responses", sorted(SIZES))
def test_the_hub_reads_the_card(responses: int, tmp_path: Path) -> None:
    """By huggingface_hub's own reader; its validate() asks the Hub, which the tests cannot reach."""
    name = "".join(random.Random(responses).choices("aB: #'\"é-@{}[]", k=12)).strip() + "x"
    card = card_of(corpus_of(tmp_path / "corpus", responses), name)
    data = card.data.to_dict()
    assert data["pretty_name"] == name
    assert (data["license"], data["size_categories"]) == ("cc-by-4.0", [SIZES[responses]])
    assert data["configs"][0]["data_files"] == [{"split": "train", "path": "manifest.jsonl"}]
    assert f"{responses:,} simulated" in card.text
    assert "seed: 1\nscenes:" in card.text
    assert (
        not set(data)
        - {"pretty_name", "license", "configs", "tags", "size_categories"}
        - {
            *("language_creators", "annotations_creators", "source_datasets", "task_categories"),
        }
    )


def test_the_card_of_a_corpus_of_the_program(tmp_path: Path) -> None:
    program = os.environ.get("EARSHOT_PROGRAM")
    if program is None:
        pytest.skip("no program (EARSHOT_PROGRAM)")
    sizes = ["shoeboxes.count=1", "scenes=[]", "sources_per_room=1", "listeners_per_source=2", "acoustics.rir_length_s=0.3"]
    command = [program, "dataset", "rir", str(ROOT / "configs/datasets/rir.yaml"), "--out", str(tmp_path / "corpus"), "--set", *sizes]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    card = card_of(tmp_path / "corpus", "Rooms")
    assert "| responses | 2 |" in card.text
    assert "| channels | left, right |" in card.text
    for config in card.data.to_dict()["configs"]:
        for files in config["data_files"]:
            assert (tmp_path / "corpus" / files["path"]).stat().st_size > 0


def test_what_is_no_corpus_is_an_error(tmp_path: Path) -> None:
    done = run("huggingface/make_card.py", str(tmp_path), "--name", "x", "--license", "mit")
    assert done.returncode == 1
    assert "is no complete corpus of earshot dataset rir" in done.stderr
    assert not (tmp_path / "README.md").exists()
