"""``bench new-method``: a package with a method that works, its entry point and its test."""

from __future__ import annotations

import importlib.util
import keyword
import re
from pathlib import Path
from typing import Final

from algorithms.registry import method_names
from bench.errors import UsageError

SKELETON: Final = Path(__file__).parent / "skeleton"
FILES: Final = {
    "method.py.txt": "my_method.py",
    "test_method.py.txt": "test_my_method.py",
    "pyproject.toml.txt": "pyproject.toml",
}
_NAME: Final = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")


def new_method(name: str, out: Path) -> Path:
    """Write the package into a new folder of that name.

    Args:
        name: Name of the method, as in ``my-method``.
        out: Where the folder goes; made if need be.

    Returns:
        The new folder.

    Raises:
        UsageError: The name cannot be used, is taken, or the folder exists.
    """
    module = name.replace("-", "_")
    if not _NAME.fullmatch(name):
        raise UsageError(f"Method name {name!r}: use small letters, digits and single hyphens, as in my-method.")
    if name in method_names():
        raise UsageError(f"Method name {name!r} is taken: choose another one; bench list shows all.")
    if keyword.iskeyword(module) or importlib.util.find_spec(module) is not None:
        raise UsageError(f"Method name {name!r}: Python already has a module {module!r}; choose another name.")
    folder = out / name
    if folder.exists():
        raise UsageError(f"{folder} exists: choose another name, or another place with --out.")
    class_name = "".join(part.capitalize() for part in name.split("-"))
    folder.mkdir(parents=True)
    for template, target in FILES.items():
        text = (SKELETON / template).read_text("utf-8")
        for placeholder, value in (("my-method", name), ("my_method", module), ("MyMethod", class_name)):
            text = text.replace(placeholder, value)
        (folder / target.replace("my_method", module)).write_text(text, "utf-8")
    return folder
