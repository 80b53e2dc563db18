"""What data determine, in text and figures."""

from kneejax.report.identification._document import (
    identification_document as identification_document,
)
from kneejax.report.identification._document import identification_doubts as identification_doubts
from kneejax.report.identification._document import identification_outcome as identification_outcome
from kneejax.report.identification._information_figures import (
    information_correlation_figure as information_correlation_figure,
)
from kneejax.report.identification._information_figures import spectrum_figure as spectrum_figure
from kneejax.report.identification._information_text import (
    INFORMATION_COLUMNS as INFORMATION_COLUMNS,
)
from kneejax.report.identification._information_text import information_rows as information_rows
from kneejax.report.identification._information_text import information_text as information_text
from kneejax.report.identification._information_words import information_notes as information_notes
from kneejax.report.identification._information_words import reason_words as reason_words
from kneejax.report.identification._information_words import slack_words as slack_words
from kneejax.report.identification._information_words import sloppy_words as sloppy_words
from kneejax.report.identification._information_words import stiff_words as stiff_words
from kneejax.report.identification._profile_figures import profiles_figure as profiles_figure
from kneejax.report.identification._text import ESTIMATE_COLUMNS as ESTIMATE_COLUMNS
from kneejax.report.identification._text import estimate_rows as estimate_rows
from kneejax.report.identification._text import estimates_text as estimates_text
from kneejax.report.identification._text import fit_doubts as fit_doubts
from kneejax.report.identification._text import undetermined_words as undetermined_words
