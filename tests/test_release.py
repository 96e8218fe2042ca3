"""What a release is made of agrees with pyproject.toml, where its version and dependencies stand."""

import re
import tomllib
from importlib import metadata
from pathlib import Path

import jinja2
import pytest

import coilarray as ca

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
yaml = pytest.importorskip("yaml", reason="PyYAML, which distributed needs, is not installed")


def read(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_every_file_has_the_version_of_the_project():
    assert metadata.version("coilarray") == ca.__version__ == PROJECT["version"]
    assert yaml.safe_load(read("CITATION.cff"))["version"] == PROJECT["version"]
    assert re.search(r"^## (\S+)", read("CHANGELOG.md"), re.MULTILINE)[1] == PROJECT["version"]


def test_the_conda_recipe_has_version_and_dependencies_of_the_project():
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(read("packaging/conda/meta.yaml"))
    data = tomllib.loads(read("pyproject.toml"))
    recipe = yaml.safe_load(template.render(load_file_data=lambda *_, **__: data, PYTHON="python"))
    assert recipe["package"] == {"name": "coilarray", "version": PROJECT["version"]}
    assert recipe["build"]["entry_points"] == ["coilarray = coilarray.__main__:start"]
    python, *needed = recipe["requirements"]["run"]
    assert python == f"python {PROJECT['requires-python']}"
    bounds = [re.fullmatch(r"[\w-]+ (>=[\d.<>=,]+)", line)[1] for line in needed]  # one package with its bounds each
    declared = PROJECT["dependencies"] + PROJECT["optional-dependencies"]["3d"]
    assert bounds == [re.search(r">=.*", line)[0] for line in declared]


def test_links_of_the_readme_lead_somewhere():
    """Package indexes show the README by itself: once the project has an address, its links must have it too."""
    links = re.findall(r"\]\(([^)]+)\)", read("README.md"))
    assert links
    for link in links:
        assert link.startswith("https://") if PROJECT.get("urls") else (ROOT / link).is_file(), link
