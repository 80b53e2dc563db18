"""Numbers of a knee by name: selected, bounded, scaled; which motions are a knee's."""

from kneejax.parameters._bounds import *
from kneejax.parameters._changed import *
from kneejax.parameters._numbers import *
from kneejax.parameters._selection import *
