"""Reads what an XML document must have, strictly: each error names the element and the reason."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable

from shared.solids import Vector3


class XmlError(ValueError):
    """What is wrong with an element, without the document's name."""


def root_of(text: str, tag: str) -> ET.Element:
    """The root element of a document, which must be called `tag`.

    Raises:
        XmlError: another root, no XML, or a document type declaration: entities could make it endless.
    """
    if "<!DOCTYPE" in text:
        raise XmlError("a document type declaration is not allowed")
    try:
        root = ET.fromstring(text)  # noqa: S314 - without a document type there are no entities to expand
    except ET.ParseError as error:
        raise XmlError(f"not valid XML: {error}") from error
    if root.tag != tag:
        raise XmlError(f"the root element must be <{tag}>, is <{root.tag}>")
    return root


def refuse_duplicates(what: str, names: Iterable[str]) -> None:
    """Raises XmlError if a name occurs twice."""
    for name, count in Counter(names).items():
        if count > 1:
            raise XmlError(f"{what} '{name}': defined {count} times")


def child_of(element: ET.Element, tag: str, where: str) -> ET.Element:
    """The first child of that tag; XmlError if there is none."""
    child = element.find(tag)
    if child is None:
        raise XmlError(f"{where}: <{tag}> is missing")
    return child


def attribute(element: ET.Element, key: str, where: str) -> str:
    """An attribute that must be there and not be empty; else XmlError."""
    value = element.get(key)
    if not value:
        raise XmlError(f"{where}: attribute '{key}' is missing")
    return value


def number(element: ET.Element, key: str, where: str) -> float:
    """An attribute that must be one finite number; else XmlError."""
    return finite_numbers(attribute(element, key, where), 1, f"{where}: {key}")[0]


def positive(element: ET.Element, key: str, where: str) -> float:
    """An attribute that must be one finite number above zero; else XmlError."""
    return all_positive([number(element, key, where)], f"{where}: {key}")[0]


def vector(element: ET.Element | None, key: str, default: Vector3 | None, where: str) -> Vector3:
    """An attribute of three finite numbers, `default` where element or attribute is missing; else XmlError."""
    text = None if element is None else element.get(key)
    if text is None:
        if default is not None:
            return default
        raise XmlError(f"{where}: attribute '{key}' is missing")
    x, y, z = finite_numbers(text, 3, f"{where}: {key}")
    return x, y, z


def finite_numbers(text: str, count: int, where: str) -> list[float]:
    """So many finite numbers, separated by blanks; else XmlError."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise XmlError(f"{where}: needs {count} finite number{'s' if count > 1 else ''}, got '{text:.80}'")
    return values


def all_positive(values: list[float], where: str) -> list[float]:
    """The values, if each is above zero; else XmlError."""
    if min(values) <= 0:
        raise XmlError(f"{where} must be positive, got {' '.join(f'{value:g}' for value in values)}")
    return values


def words(values: Iterable[float]) -> str:
    """Numbers as an attribute or text of XML; read again they are the same floats."""
    return " ".join(repr(float(value) + 0.0) for value in values)  # + 0.0 turns -0.0 into 0.0
