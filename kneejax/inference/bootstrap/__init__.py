"""How far an answer scatters when its data are made again."""

from kneejax.inference.bootstrap._parametric import bootstrap as bootstrap
