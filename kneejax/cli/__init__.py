"""The command line: read arguments, call, print."""

import time

from kneejax.cli._streams import stopped_at_once


def main(arguments: list[str] | None = None) -> int:
    """Run the `kneejax` command.

    Args:
        arguments: words after `kneejax`; those of the process by default.

    Returns:
        Exit status: 0 done; 1 done, but something is doubtful (the results say what); 2 bad
        input, nothing written; 130 stopped by Ctrl-C.
    """
    begun = time.perf_counter()
    with stopped_at_once():
        from kneejax.cli._main import main as run
    return run(arguments, begun)
