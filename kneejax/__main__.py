"""`python -m kneejax`."""

from kneejax.cli import main

raise SystemExit(main())
