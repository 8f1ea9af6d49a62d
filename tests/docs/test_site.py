"""The documentation site: built without warnings, complete, and without a single request to another host."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXTERNAL = re.compile(r"""(?:src=|url\(|@import\s+|<link[^>]*href=)["']?(?:https?:)?//[^"')\s>]+""")


def hook(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / "hooks" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder


def test_every_page_is_built_and_none_asks_another_host(site: Path) -> None:
    built = {path.stem for path in site.glob("*.html")} - {"404"}
    assert built == {path.stem for path in (ROOT / "docs").glob("*.md")} | {"cli"}
    for path in [*site.rglob("*.html"), *site.rglob("*.css")]:
        assert EXTERNAL.findall(path.read_text("utf-8")) == [], path.name


def test_every_formula_is_drawn_without_a_script(site: Path) -> None:
    for path in site.glob("*.html"):
        assert "arithmatex" not in path.read_text("utf-8"), path.name
    assert "<mfrac>" in (site / "guard.html").read_text("utf-8")


def test_a_formula_that_is_not_understood_ends_the_build() -> None:
    formulas = hook("formulas")
    assert "<mfrac>" in formulas.mathml(r"\frac{a}{b}", "block")
    with pytest.raises(Exception, match=r"\\nosuchcommand"):
        formulas.mathml(r"\nosuchcommand{a}", "block")


def test_the_page_of_commands_has_every_command_with_every_option() -> None:
    page = hook("cli_page")
    sections = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", page.page(), re.DOTALL | re.MULTILINE))
    names = [name for name, _ in page.commands()]
    assert sorted(sections) == sorted(names)
    assert {"bench run", "bench speed engine", "bench stress guard", "bench why"} <= set(names)
    for name, command in page.commands():
        for parameter in command.params:
            for option in parameter.opts:
                assert option in sections[name] or parameter.param_type_name == "argument", (name, option)
        assert command.help.split("\n")[0].split(".")[0][:40] in sections[name], name
