"""Logging of every process: structlog to stderr, plain lines at a terminal, JSON lines on request."""

from __future__ import annotations

import logging
import sys

import structlog


def configure_logs(*, verbosity: int = 0, is_json: bool = False) -> None:
    """Sets the level (-1 warnings, 0 information, 1 everything) and the form of all further log lines."""
    level = {-1: logging.WARNING, 0: logging.INFO}.get(verbosity, logging.DEBUG)
    renderer: structlog.typing.Processor = (
        structlog.processors.JSONRenderer() if is_json else structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())
    )
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="%H:%M:%S" if not is_json else "iso", utc=is_json),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=False,
    )
