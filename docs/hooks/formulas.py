"""Turns TeX into MathML while the site is built: browsers draw it without scripts, fonts or network."""

from __future__ import annotations

import html
import re
from typing import Any, Final

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError

_FORMULA: Final = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def mathml(tex: str, display: str) -> str:
    """One formula as a `<math>` element; display is ``block`` or ``inline``.

    Raises:
        PluginError: The formula has a command that is not understood, which would be printed as it stands.
    """
    element: str = convert(tex.strip(), display=display)
    unknown = re.search(r"\\[A-Za-z]+", html.unescape(element))
    if unknown:
        raise PluginError(f"{unknown.group()} in the formula {tex.strip()!r} is not understood.")
    return element


def on_page_content(content: str, **_: Any) -> str:
    """MkDocs calls this with the HTML of every page."""
    return _FORMULA.sub(
        lambda found: mathml(html.unescape(found[2]), "block" if found[1] == "div" else "inline"), content
    )
