"""Commands for those who add methods."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.cli.app import AsJson, app, reports_errors, show


@app.command("list")
@reports_errors
def list_(as_json: AsJson = False) -> None:
    """List methods and scenarios, also those that cannot be used here, with the reason."""
    from bench import listing

    show(listing.as_json() if as_json else listing.as_text())


@app.command()
@reports_errors
def check(
    name: Annotated[str, typer.Argument(help="Method, with parameters as in safety-guard:tc=1.0.")],
    as_json: AsJson = False,
) -> None:
    """Run the contract that every method must keep; exit code 1 if it does not."""
    from bench import contract
    from bench.text import columns, json_text

    report = contract.check_method(name)
    rows = [("ok" if found.passed else "FAILED", found.name, found.detail) for found in report.checks]
    verdict = f"{name} keeps the contract." if report.passed else f"{name} does not keep the contract: see FAILED."
    show(json_text(report.as_json()) if as_json else f"{columns(('', 'check', 'found'), rows)}\n{verdict}")
    raise typer.Exit(0 if report.passed else 1)


@app.command("new-method")
@reports_errors
def new_method(
    name: Annotated[str, typer.Argument(help="Name of the new method, as in my-method.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where its folder goes.")] = Path(),
    as_json: AsJson = False,
) -> None:
    """Write a package with a method that works, its entry point and its test."""
    from bench import new_method as skeleton
    from bench.text import json_text

    folder = skeleton.new_method(name, out)
    if as_json:
        show(json_text({"method": name, "folder": str(folder)}))
        return
    show(f"{folder}: install it with  python -m pip install --no-build-isolation --no-deps -e {folder}")
    show(f"then  bench check {name}")
