"""Commands for those who add methods."""

from __future__ import annotations

from bench.cli.app import AsJson, app, reports_errors, show


@app.command("list")
@reports_errors
def list_(as_json: AsJson = False) -> None:
    """List methods and scenarios, also those that cannot be used here, with the reason."""
    from bench import listing

    show(listing.as_json() if as_json else listing.as_text())
