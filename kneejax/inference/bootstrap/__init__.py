"""How far an answer scatters when its data are drawn again."""

from kneejax.inference.bootstrap._bootstrap import bootstrap as bootstrap
from kneejax.inference.bootstrap._bootstrap import bootstrap_by_blocks as bootstrap_by_blocks
from kneejax.inference.bootstrap._bootstrap import check_curves as check_curves
from kneejax.inference.bootstrap._bootstrap import check_redrawn as check_redrawn
from kneejax.inference.bootstrap._bootstrap import curves_of as curves_of
