"""`python -m kneejax.cli`."""

from kneejax.cli import main

raise SystemExit(main())
