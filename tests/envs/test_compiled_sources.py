"""A change of any file that defines kernels makes a new folder of compiled code."""

from pathlib import Path

import pytest

from envs import compiled

DEFINES = [path for path in sorted((compiled._PROJECT / "algorithms").glob("*.py")) if "@njit" in path.read_text()]


@pytest.mark.parametrize("path", DEFINES, ids=lambda path: path.name)
def test_the_digest_knows_every_file_with_kernels(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("envs", "algorithms"):
        (tmp_path / folder).mkdir()
    copy = tmp_path / "algorithms" / path.name
    copy.write_bytes(path.read_bytes())
    monkeypatch.setattr(compiled, "_PROJECT", tmp_path)
    before = compiled._source_digest()
    copy.write_bytes(path.read_bytes() + b"\n# changed\n")
    assert compiled._source_digest() != before
