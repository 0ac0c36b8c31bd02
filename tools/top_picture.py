"""The picture of `hyrecro top` in the documentation: `python -m tools.top_picture tcp/127.0.0.1:7447 OUT.svg`."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from cli.watching import snapshot
from shared.runtime.config import BusConfig

_COLUMNS = 80


def main() -> None:
    """Draws what the router at the endpoint shows now."""
    parser = argparse.ArgumentParser(prog="python -m tools.top_picture", description=__doc__)
    parser.add_argument("endpoint")
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    console = Console(record=True, width=_COLUMNS, quiet=True, force_terminal=True)
    console.print(snapshot(BusConfig(endpoint=arguments.endpoint)))
    console.save_svg(str(arguments.out), title="hyrecro top")


if __name__ == "__main__":
    main()
