"""The house rules that no formatter checks: import direction, privacy, file length, a light command line."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LAYERS = ("envs", "algorithms", "bench", "paper_tables")  # lowest first; a layer sees itself and those below
HEAVY = ("torch", "numba", "pandas", "stable_baselines3", "highway_env", "omnisafe")
MAX_LINES = 300


def source_files(root: Path) -> Iterator[Path]:
    for layer in LAYERS:
        yield from sorted((root / layer).rglob("*.py"))


def dotted_name(path: Path, root: Path) -> str:
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def is_module(name: str, root: Path) -> bool:
    path = root.joinpath(*name.split("."))
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def is_private(name: str) -> bool:
    return name.startswith("_") and not (name.startswith("__") and name.endswith("__"))


def imports(path: Path, tree: ast.AST, root: Path) -> Iterator[tuple[int, str, str | None, str]]:
    """Yield (line, module, name taken from it or None, name bound here), at any depth of the file."""
    package = dotted_name(path.parent / "__init__.py", root).split(".")
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                for alias in names:
                    yield node.lineno, alias.name, None, alias.asname or alias.name
            case ast.ImportFrom(module=module, names=names, level=level):
                base = package[: len(package) - level + 1] if level else []
                origin = ".".join([*base, *([module] if module else [])])
                for alias in names:
                    yield node.lineno, origin, alias.name, alias.asname or alias.name
            case ast.Call(
                func=ast.Name(id="import_module" | "__import__") | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(module)), *_],
            ):
                yield node.lineno, module, None, ""


def upward_imports(root: Path) -> list[str]:
    """Each import of a higher layer, as 'file:line imports module'."""
    found = []
    for path in source_files(root):
        own = LAYERS.index(path.relative_to(root).parts[0])
        for line, module, _, _ in imports(path, ast.parse(path.read_text("utf-8")), root):
            if module.split(".")[0] in LAYERS[own + 1 :]:
                found.append(f"{path.relative_to(root)}:{line} imports {module}")
    return found


def private_imports(root: Path) -> list[str]:
    """Each use of another module's private name; a private *module* belongs to the package that holds it."""
    found = []
    for path in source_files(root):
        tree = ast.parse(path.read_text("utf-8"))
        where = path.relative_to(root)
        package = dotted_name(path.parent / "__init__.py", root)
        modules = set()
        for line, module, name, bound in imports(path, tree, root):
            if module.split(".")[0] not in LAYERS:
                continue
            target = f"{module}.{name}" if name else module
            if name is None or is_module(target, root):
                modules.add(bound)
                trespass = enters_private_package(target, package)
            else:
                trespass = is_private(name) or enters_private_package(module, package)
            if trespass:
                found.append(f"{where}:{line} imports {target}")
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and is_private(node.attr) and ast.unparse(node.value) in modules:
                found.append(f"{where}:{node.lineno} uses {ast.unparse(node)}")
    return found


def enters_private_package(module: str, package: str) -> bool:
    """Whether a path such as bench.statistics._checks is private to a package that `package` is not in."""
    parts = module.split(".")
    for depth, part in enumerate(parts):
        owner = ".".join(parts[:depth])
        if is_private(part) and not f"{package}.".startswith(f"{owner}."):
            return True
    return False


def long_files(root: Path) -> list[str]:
    scripts = (path for path in sorted(root.glob("bench/**/*.js")) if path.parent.name != "vendor")
    lengths = {path: len(path.read_text("utf-8").splitlines()) for path in (*source_files(root), *scripts)}
    return [f"{path.relative_to(root)}: {n} lines" for path, n in lengths.items() if n > MAX_LINES]


def heavy_modules_after_import(module: str, root: Path) -> list[str]:
    """The heavy modules that a fresh interpreter has loaded after it imported `module` from `root`."""
    code = f"import sys, {module}; print(*sorted(set({HEAVY!r}) & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_every_layer_exists() -> None:
    assert [layer for layer in LAYERS if not (ROOT / layer / "__init__.py").is_file()] == []


def test_imports_run_one_way() -> None:
    assert upward_imports(ROOT) == []


def test_no_module_uses_another_modules_private_names() -> None:
    assert private_imports(ROOT) == []


def test_no_file_is_longer_than_300_lines() -> None:
    assert long_files(ROOT) == []


def test_the_command_line_imports_nothing_heavy() -> None:
    assert (ROOT / "bench" / "cli").is_dir(), "bench/cli is missing"
    assert heavy_modules_after_import("bench.cli.commands", ROOT) == []


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A small project that keeps every rule."""
    files = {
        "envs/world.py": "speed = 1\n_hidden = 2\n",
        "envs/_kernels.py": "step = 1\n",
        "envs/engine.py": "from envs import _kernels, world\nfrom envs._kernels import step\nworld.speed\n",
        "algorithms/sac.py": "from envs.world import speed\nimport numpy._core\n",
        "bench/runner.py": "import algorithms.sac\nfrom .cli import main\n",
        "bench/cli.py": "def main():\n    import torch\n",
        "paper_tables/draw.py": "import bench.runner\nfrom envs.world import speed\n",
        **{f"{layer}/__init__.py": "" for layer in LAYERS},
        **{f"{heavy}.py": "" for heavy in HEAVY},
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    return tmp_path


def test_a_tree_that_keeps_the_rules_passes(tree: Path) -> None:
    assert upward_imports(tree) == []
    assert private_imports(tree) == []
    assert long_files(tree) == []
    assert heavy_modules_after_import("bench.cli", tree) == []


@pytest.mark.parametrize(
    ("file", "line", "module"),
    [
        ("envs/world.py", "import algorithms", "algorithms"),
        ("envs/world.py", "from paper_tables.draw import x", "paper_tables.draw"),
        ("algorithms/sac.py", "def f():\n    from bench import runner", "bench"),
        ("algorithms/sac.py", "import importlib\nimportlib.import_module('bench.cli')", "bench.cli"),
        ("bench/cli.py", "import paper_tables.draw as p", "paper_tables.draw"),
    ],
)
def test_an_upward_import_is_found(tree: Path, file: str, line: str, module: str) -> None:
    (tree / file).write_text(line + "\n", "utf-8")
    assert upward_imports(tree) == [f"{file}:{line.count(chr(10)) + 1} imports {module}"]


@pytest.mark.parametrize(
    ("file", "line", "message"),
    [
        ("envs/engine.py", "from envs.world import _hidden", "1 imports envs.world._hidden"),
        ("envs/engine.py", "from .world import _hidden as h", "1 imports envs.world._hidden"),
        ("envs/engine.py", "from envs import world as w\nw._hidden", "2 uses w._hidden"),
        ("bench/cli.py", "import envs.world\nenvs.world._hidden", "2 uses envs.world._hidden"),
        ("bench/cli.py", "from envs import _kernels", "1 imports envs._kernels"),
        ("bench/cli.py", "from envs._kernels import step", "1 imports envs._kernels.step"),
        ("bench/cli.py", "import envs._kernels", "1 imports envs._kernels"),
    ],
)
def test_use_of_a_private_name_is_found(tree: Path, file: str, line: str, message: str) -> None:
    (tree / file).write_text(line + "\n", "utf-8")
    assert private_imports(tree) == [f"{file}:{message}"]


def test_a_file_of_301_lines_is_found(tree: Path) -> None:
    (tree / "envs/world.py").write_text("x = 1\n" * MAX_LINES, "utf-8")
    assert long_files(tree) == []
    (tree / "envs/world.py").write_text("x = 1\n" * (MAX_LINES + 1), "utf-8")
    assert long_files(tree) == ["envs/world.py: 301 lines"]
    (tree / "envs/world.py").unlink()
    (tree / "bench").mkdir(exist_ok=True)
    (tree / "bench/page.js").write_text("x\n" * (MAX_LINES + 1), "utf-8")
    assert long_files(tree) == ["bench/page.js: 301 lines"]


@pytest.mark.parametrize("heavy", HEAVY)
def test_a_heavy_import_behind_another_module_is_found(tree: Path, heavy: str) -> None:
    (tree / "bench/runner.py").write_text(f"import {heavy}\n", "utf-8")
    (tree / "bench/cli.py").write_text("from bench import runner\n", "utf-8")
    assert heavy_modules_after_import("bench.cli", tree) == [heavy]
