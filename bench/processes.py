"""The processes of a running pipeline, by name."""

from __future__ import annotations

import psutil


def named_children(process: psutil.Process) -> dict[str, psutil.Process]:
    """Router and services that `hyrecro up` has started: a sensor by its own name, a service by its module's."""
    named = {}
    for child in process.children():
        try:
            arguments = child.cmdline()
        except psutil.NoSuchProcess:  # ended since
            continue
        if "--sensor" in arguments:
            named[arguments[arguments.index("--sensor") + 1]] = child
        elif "-m" in arguments:
            module = arguments[arguments.index("-m") + 1]
            named["router" if module == "cli.main" else module.rpartition(".")[2]] = child
    return named
