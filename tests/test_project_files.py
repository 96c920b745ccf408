"""Files for services and tools name commands, folders and extras that are there."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
CI = (ROOT / ".ci" / "run").read_text()


def loaded(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text())


def test_pre_commit_runs_the_checks_of_ci():
    [repository] = loaded(".pre-commit-config.yaml")["repos"]
    step = re.search(r'^step "Lint, [^\n]*\n(.*?)\n\n', CI, re.M | re.S)
    assert step
    assert [hook["entry"] for hook in repository["hooks"]] == step[1].splitlines()
    assert {hook["language"] for hook in repository["hooks"]} == {"system"}


def test_the_workflow_calls_ci_on_three_systems_and_builds_the_packages():
    jobs = loaded(".github/workflows/ci.yml")["jobs"]
    systems = {name.split("-")[0] for name in jobs["ci"]["strategy"]["matrix"]["os"]}
    assert systems == {"ubuntu", "macos", "windows"}
    runs = {name: [s["run"] for s in job["steps"] if "run" in s] for name, job in jobs.items()}
    assert runs == {"ci": ["bash .ci/run"], "packages": ["bash .ci/packages"]}
    assert all((ROOT / command.split()[1]).is_file() for run in runs.values() for command in run)
    oldest = jobs["ci"]["strategy"]["matrix"]["python"][0]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["requires-python"] == f">={oldest}"


def test_read_the_docs_builds_as_ci_does():
    settings = loaded(".readthedocs.yaml")
    assert (ROOT / settings["sphinx"]["configuration"]).is_file()
    assert settings["sphinx"]["fail_on_warning"]
    assert "sphinx-build -q -W" in CI
    [install] = settings["build"]["jobs"]["install"]
    assert install.endswith("-c constraints.txt -e '.[dev]'")


def test_the_container_runs_the_demonstration():
    text = (ROOT / "Dockerfile").read_text()
    assert 'ENTRYPOINT ["farpoint"]\nCMD ["demo"]' in text
    ignored = (ROOT / ".dockerignore").read_text().split()
    needed = {"constraints.txt", "pyproject.toml", "README.md", "LICENSE", "src"}
    assert not needed & set(ignored)


@pytest.mark.parametrize("form", sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("[!c]*.yml")))
def test_a_form_asks_each_thing_once(form: Path):
    fields = yaml.safe_load(form.read_text())["body"]
    names = [field["id"] for field in fields]
    assert len(names) == len(set(names)) > 0
    assert any(field.get("validations", {}).get("required") for field in fields)


def test_the_package_is_typed():
    assert (ROOT / "src" / "farpoint" / "py.typed").is_file()


def test_no_file_names_a_package_index():
    # The words in two parts, since this file is looked at, too.
    words = ["index" + "-url", "find" + "-links", "py" + "pi.org", "shields" + ".io"]
    pattern = "|".join(map(re.escape, words))
    command = ["git", "grep", "-IilE", pattern]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if found.returncode == 128:
        pytest.skip("not a Git repository")
    assert found.stdout == ""
