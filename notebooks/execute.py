"""Execute every notebook of this folder, and fail on the first error.

Usage: `python notebooks/execute.py [--out FOLDER] [NAME.ipynb ...]`. With
`KNEEJAX_NOTEBOOK_QUICK=1` the notebooks use fewer poses. The files themselves stay as they are,
without outputs; `--out` writes copies with outputs, which `docs/conf.py` shows on the site
(`KNEEJAX_NOTEBOOKS=FOLDER`).
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

FOLDER = Path(__file__).resolve().parent
TIMEOUT_S = 600


def main() -> int:
    """Execute notebooks and report each; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="folder for copies with outputs")
    parser.add_argument("names", nargs="*", metavar="NAME.ipynb")
    asked = parser.parse_args()
    names = asked.names
    if asked.out is not None:
        asked.out.mkdir(parents=True, exist_ok=True)
    paths = [FOLDER / Path(name).name for name in names] or sorted(FOLDER.glob("*.ipynb"))
    failed = 0
    for path in paths:
        begun = time.perf_counter()
        notebook = nbformat.read(path, as_version=4)
        client = NotebookClient(
            notebook,
            timeout=TIMEOUT_S,
            kernel_name="python3",
            resources={"metadata": {"path": str(FOLDER)}},
        )
        try:
            client.execute()
            verdict = "passed"
            if asked.out is not None:
                nbformat.write(notebook, asked.out / path.name)
        except CellExecutionError as error:
            failed += 1
            verdict = f"FAILED\n{error}"
        print(f"{path.name}: {verdict} ({time.perf_counter() - begun:.0f} s)", flush=True)
    return 1 if failed or not paths else 0


if __name__ == "__main__":
    raise SystemExit(main())
