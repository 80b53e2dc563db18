"""Numbers of a knee by name: selected, bounded, scaled; which motions are a knee's."""

from kneejax.parameters._bounds import default_bounds as default_bounds
from kneejax.parameters._bounds import digitised as digitised
from kneejax.parameters._bounds import looked_up as looked_up
from kneejax.parameters._bounds import percent_scales as percent_scales
from kneejax.parameters._bounds import prior_scales as prior_scales
from kneejax.parameters._bounds import start_within as start_within
from kneejax.parameters._bounds import stated as stated
from kneejax.parameters._bounds import stated_bounds as stated_bounds
from kneejax.parameters._bounds import structure_range as structure_range
from kneejax.parameters._bounds import unphysiological as unphysiological
from kneejax.parameters._changed import cut as cut
from kneejax.parameters._changed import fibres_cut as fibres_cut
from kneejax.parameters._changed import replaced as replaced
from kneejax.parameters._changed import without_menisci as without_menisci
from kneejax.parameters._numbers import MEANING as MEANING
from kneejax.parameters._numbers import Assumption as Assumption
from kneejax.parameters._numbers import DoubtfulValue as DoubtfulValue
from kneejax.parameters._numbers import doubt_prior as doubt_prior
from kneejax.parameters._numbers import doubt_value as doubt_value
from kneejax.parameters._numbers import fibres_summed as fibres_summed
from kneejax.parameters._numbers import sums_in_words as sums_in_words
from kneejax.parameters._selection import Selection as Selection
from kneejax.parameters._selection import UnknownParameter as UnknownParameter
from kneejax.parameters._selection import UnsuitableData as UnsuitableData
from kneejax.parameters._selection import fibre_rows as fibre_rows
from kneejax.parameters._selection import select as select
