"""The command line: read arguments, call, print."""

from kneejax.cli._main import main as main
