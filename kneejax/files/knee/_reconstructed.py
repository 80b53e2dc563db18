"""A knee document in which grafts stand in the place of torn fibres."""

from __future__ import annotations

import copy
import fnmatch
from collections.abc import Sequence
from typing import Any

import numpy as np

from kneejax.files.knee._mirror import mirror_document
from kneejax.files.knee._restated import FIBRE
from kneejax.mechanics import Knee

_ENDS = {
    "femoral_attachment_mm": "femoral_attachment",
    "tibial_attachment_mm": "tibial_attachment",
}


def reconstructed(
    document: dict[str, Any],
    knee: Knee,
    torn: Sequence[str],
    grafts: Sequence[str],
    source: str,
) -> dict[str, Any]:
    """A knee document without its torn fibres, and with grafts.

    Args:
        document: content of a knee file, of either side.
        knee: a knee of two bones that has the grafts among its ligaments, fixed; a left one as its
            mirrored right twin.
        torn: fibres of the document that are taken out; groups without a fibre go with them.
        grafts: fibres of `knee` that are put in, straight between their ends. Several are a group
            `graft`.
        source: of the grafts' numbers.

    Returns:
        A new document; the others of its numbers are those of `document`.

    Example:
        >>> from kneejax.files import load_knee_file
        >>> read = load_knee_file("four_ligament")
        >>> own = reconstructed(read.document, read.knee, ["ACL"], ["ACL"], "my own")["ligaments"]
        >>> [*own], round(own["ACL"]["slack_length_mm"], 2), own["ACL"]["source"]
        (['PCL', 'MCL', 'LCL', 'ACL'], 25.82, 'my own')
    """
    left = document["side"] == "left"
    right = mirror_document(document) if left else copy.deepcopy(document)
    for name in torn:
        del right["ligaments"][name]
    fibres = knee.ligaments
    for name in grafts:
        row = fibres.names.index(name)
        numbers = {"slack_length_mm": fibres.slack_length[row]}
        numbers |= {field: getattr(fibres, own)[row] for field, own in (_ENDS | FIBRE).items()}
        entry = {field: np.asarray(value, float).tolist() for field, value in numbers.items()}
        right["ligaments"][name] = entry | {"source": source}
    known = tuple(right["ligaments"])
    kept = {
        group: [pattern for pattern in patterns if fnmatch.filter(known, pattern)]
        for group, patterns in right.pop("groups", {}).items()
    }
    groups = {group: patterns for group, patterns in kept.items() if patterns}
    if len(grafts) > 1:
        groups["graft"] = [*grafts]
    if groups:
        right["groups"] = groups
    return mirror_document(right) if left else right
