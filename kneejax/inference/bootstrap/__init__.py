"""How far an answer scatters when its data are drawn again."""

from kneejax.inference.bootstrap._answered import check_redrawn as check_redrawn
from kneejax.inference.bootstrap._by_blocks import bootstrap_by_blocks as bootstrap_by_blocks
from kneejax.inference.bootstrap._by_blocks import check_curves as check_curves
from kneejax.inference.bootstrap._by_blocks import curves_of as curves_of
from kneejax.inference.bootstrap._parametric import bootstrap as bootstrap
