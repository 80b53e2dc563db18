"""`python -m kneejax.cli`."""

from kneejax.cli._main import main

raise SystemExit(main())
