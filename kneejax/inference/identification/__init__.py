"""Which parameters data determine."""

from kneejax.inference.identification._identify import Identification as Identification
from kneejax.inference.identification._identify import check_enough as check_enough
from kneejax.inference.identification._identify import identify as identify
from kneejax.inference.identification._information import Information as Information
from kneejax.inference.identification._information import fit_information as fit_information
from kneejax.inference.identification._information import information as information
from kneejax.inference.identification._information import noise_of as noise_of
