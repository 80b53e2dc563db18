"""Names of a model as a knee file allows them."""

from __future__ import annotations

import re


def file_names(keys: list[str], prefix: str) -> list[str]:
    """Names that a knee file allows, each once."""
    answer: list[str] = []
    for key in keys:
        name = re.sub(r"[^A-Za-z0-9_+-]", "_", key)
        name = name if re.match(r"[A-Za-z]", name) else f"{prefix}{name}"
        stem, count = name, 1
        while name in answer:
            count += 1
            name = f"{stem}_{count}"
        answer.append(name)
    return answer
