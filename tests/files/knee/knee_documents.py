"""Knee documents with a change, as files: what the tests of this folder share."""

from kneejax.files import format_knee


def write(path, document):
    """Write a document as a knee file; its path."""
    path.write_text(format_knee(document), encoding="utf-8")
    return path


def changed(document, place, value):
    """The document itself, with another value at a place; None takes the field away."""
    part = document
    *way, last = place
    for name in way:
        part = part[name]
    if value is None:
        del part[last]
    else:
        part[last] = value
    return document
