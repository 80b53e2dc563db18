"""Which parameters data determine: information, and words for it."""

from kneejax.inference.identification._identify import Identification as Identification
from kneejax.inference.identification._identify import check_enough as check_enough
from kneejax.inference.identification._identify import identify as identify
from kneejax.inference.identification._information import Information as Information
from kneejax.inference.identification._information import fit_information as fit_information
from kneejax.inference.identification._information import information as information
from kneejax.inference.identification._information import noise_of as noise_of
from kneejax.inference.identification._information_words import plain as plain
from kneejax.inference.identification._information_words import short as short
from kneejax.inference.identification._information_words import unit_of as unit_of
