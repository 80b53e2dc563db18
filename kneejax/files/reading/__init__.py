"""Text, YAML and models of files; problems that say file, field and value."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.reading._model import *
    from kneejax.files.reading._text import *
    from kneejax.files.reading._values import *
    from kneejax.files.reading._yaml import *
else:
    lazy_imports(globals())
