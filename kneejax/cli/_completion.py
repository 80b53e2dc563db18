"""`kneejax completion bash|zsh|fish`."""

from __future__ import annotations

from kneejax.cli._main import line
from kneejax.cli.options import Completion


def run(asked: Completion) -> int:
    """Print the script."""
    script = line().app(completing=True).generate_completion(shell=asked.shell)
    # Beside the names of bundled knees and studies, files may be meant.
    print(script.replace("complete -F _kneejax", "complete -o default -F _kneejax"))
    return 0
