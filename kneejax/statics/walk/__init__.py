"""Many balances: variants of a knee at stations, walked to along paths."""

from kneejax.statics.walk._balances import Balances as Balances
from kneejax.statics.walk._balances import settled_of as settled_of
from kneejax.statics.walk._batch import Progress as Progress
from kneejax.statics.walk._batch import balance_lines as balance_lines
from kneejax.statics.walk._batch import balance_many as balance_many
from kneejax.statics.walk._batch import own_motion as own_motion
from kneejax.statics.walk._batch import own_motion_near as own_motion_near
from kneejax.statics.walk._in_trace import walked_in_trace as walked_in_trace
from kneejax.statics.walk._slopes import Own as Own
from kneejax.statics.walk._slopes import Slopes as Slopes
from kneejax.statics.walk._slopes import balance_with_slopes as balance_with_slopes
from kneejax.statics.walk._stations import Stations as Stations
from kneejax.statics.walk._variants import Vary as Vary
from kneejax.statics.walk._variants import in_lanes as in_lanes
