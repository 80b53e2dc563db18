"""Files of a setting: a knee, a study that searches for it, a picture; in one folder alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from kneejax.explorer.answers import FLEXIONS
from kneejax.explorer.setting import Setting, Subject
from kneejax.files import reconstructed, restated, write_knee, write_poses
from kneejax.parameters import fibres_cut


@dataclasses.dataclass(frozen=True)
class Folder:
    """Where files go; a file that is there stays as it is, and the next number is taken."""

    path: Path  # made where the first file is written
    subject: Subject
    document: dict[str, Any]  # of its knee file
    measured: np.ndarray  # poses of a study, `(n, 6)`, degrees and mm; no row without a study

    def knee(self, setting: Setting) -> Path:
        """Write a setting as a knee file, without what is cut, the flexion and the loads."""
        path, link, whole = self._free("knee", "yaml"), _link(setting), self.subject.set_in(setting)
        rows = fibres_cut(whole, self.subject.cut_in(setting))
        torn = [whole.ligaments.names[row] for row in rows]
        document = restated(self.document, whole, link)
        write_knee(reconstructed(document, whole, torn, (), link), path, link)
        return path

    def study(self, setting: Setting) -> Path:
        """Write a study for `kneejax calibrate`.

        With measured poses its search begins at the setting. Without, its poses are those of the
        setting, to see whether a search from the knee as it was read finds its numbers.
        """
        link, names = _link(setting), self.subject.selection.names
        changed = {name: x for name, x in setting.numbers if name in names}
        knee = self.knee(Setting())
        study: dict[str, Any] = {
            "title": f"{self.subject.knee.name}, set by hand", "knee": knee.name,
            "parameters": [*changed] or ["*.stiffness", "*.reference_strain"],
        }  # fmt: skip
        if len(self.measured):
            poses = self._free("poses", "csv")
            write_poses(poses, self.measured)
            study |= {"measured": {"file": poses.name, "source": link}, "start": changed}
        else:
            study["synthetic"] = {"parameters": changed, "flexion_deg": FLEXIONS.tolist()}
        path = self._free("study", "yaml")
        path.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
        return path

    def picture(self, client: Any) -> Path:
        """Write what a page shows of the knee."""
        from PIL import Image

        path = self._free("picture", "png")
        Image.fromarray(client.get_render(1080, 1440, transport_format="png")).save(path)
        return path

    def _free(self, kind: str, ending: str) -> Path:
        self.path.mkdir(parents=True, exist_ok=True)
        names = (self.path / f"explore-{kind}-{i}.{ending}" for i in range(1, 10_000))
        return next(path for path in names if not path.exists())


def _link(setting: Setting) -> str:
    return f"kneejax explore: {setting.link or 'as read'}"
