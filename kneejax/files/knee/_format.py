"""Knee documents as text: fields in the order of the format."""

from __future__ import annotations

from typing import Any

import numpy as np

from kneejax.files.knee import _schema as schema
from kneejax.files.knee import _schema_parts as parts
from kneejax.files.reading import format_yaml
from kneejax.geometry import PATELLA, TIBIA


def format_knee(document: dict[str, Any]) -> str:
    """Write a knee document as text.

    Args:
        document: content of a knee file; NumPy numbers and arrays may stand in it.

    Returns:
        YAML with fields in the order of the format, names in the order given, every float with
        the digits that it has; the same text for the same document.

    Example:
        >>> print(format_knee({"side": "right", "name": "small", "kneejax": 1}), end="")
        kneejax: 1
        name: small
        side: right
    """
    return format_yaml(plain_document(document))


def plain_document(document: dict[str, Any]) -> dict[str, Any]:
    """A knee document of Python's own numbers, texts and lists, in the order of the format."""
    return _ordered(_plain(document))


def _plain(value: Any) -> Any:
    """The same with Python's own numbers, texts and lists."""
    if isinstance(value, dict):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy and JAX arrays and numbers
        return _plain(np.asarray(value).tolist())
    return value


_IN_ORDER = {
    "ligaments": parts.LIGAMENT_FIELDS,
    "contacts": parts.CONTACT_FIELDS,
    "muscles": parts.MUSCLE_FIELDS,
    "wraps": parts.WRAP_FIELDS,
    "lines": parts.LINE_FIELDS,
    "loads": parts.LOAD_FIELDS,
}


def _ordered(document: dict[str, Any]) -> dict[str, Any]:
    document = _sections(_sorted(document, schema.KNEE_FIELDS), TIBIA)
    patella = document.get("patella")
    if isinstance(patella, dict):
        document["patella"] = _sections(_sorted(patella, schema.PATELLA_FIELDS), PATELLA)
    surfaces = document.get("surfaces")
    if isinstance(surfaces, dict):
        document["surfaces"] = {bone: _sorted_surface(x) for bone, x in surfaces.items()}
    return document


def _sections(document: dict[str, Any], bone: str) -> dict[str, Any]:
    """The same with a bone's pose and all parts in the order of their fields."""
    if isinstance(document.get("reference_pose"), dict):
        document["reference_pose"] = _sorted(document["reference_pose"], parts.POSE_FIELDS[bone])
    for section, fields in _IN_ORDER.items():
        held = document.get(section)
        if isinstance(held, dict):
            document[section] = {name: _sorted(part, fields) for name, part in held.items()}
    return document


def _sorted(part: Any, fields: tuple[str, ...]) -> Any:
    """The same mapping, known fields first and in their order; surfaces within it likewise."""
    if not isinstance(part, dict):
        return part
    names = [name for name in fields if name in part]
    answer = {name: part[name] for name in (*names, *(x for x in part if x not in names))}
    for name in parts.FACES:
        if name in answer:
            answer[name] = _sorted_surface(answer[name])
    return answer


def _sorted_surface(surface: Any) -> Any:
    if not isinstance(surface, dict):
        return surface
    required, optional = parts.SURFACES.get(surface.get("kind"), ((), ()))  # pyright: ignore[reportCallIssue]
    order = ("kind", required[0], *optional, *required[1:]) if required else ()
    return _sorted(surface, (*order, *parts.SURFACE_EXTRAS))
