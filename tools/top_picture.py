"""The picture of `hyrecro top` in the documentation: `python -m tools.top_picture tcp/127.0.0.1:7447 OUT.svg`."""

from __future__ import annotations

import argparse
import io
import re
from pathlib import Path

from rich.console import Console

from cli.watching import snapshot
from shared.runtime.config import BusConfig

_COLUMNS = 80
_FOREIGN_FONT = re.compile(r"\s*@font-face \{.*?\}", re.DOTALL)
"""What a browser would fetch from another host to show the picture."""


def main() -> None:
    """Draws what the router at the endpoint shows now."""
    parser = argparse.ArgumentParser(prog="python -m tools.top_picture", description=__doc__)
    parser.add_argument("endpoint")
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    console = Console(record=True, width=_COLUMNS, file=io.StringIO(), force_terminal=True)
    console.print(snapshot(BusConfig(endpoint=arguments.endpoint)))
    picture = console.export_svg(title="hyrecro top")
    arguments.out.write_text(_FOREIGN_FONT.sub("", picture))


if __name__ == "__main__":
    main()
