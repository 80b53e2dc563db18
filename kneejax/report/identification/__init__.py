"""What data determine, as an answer: page, files, figures and words."""

from kneejax.report.identification._answer import identification_answer as identification_answer
from kneejax.report.identification._answer import identification_document as identification_document
from kneejax.report.identification._answer import identification_doubts as identification_doubts
from kneejax.report.identification._answer import identification_outcome as identification_outcome
from kneejax.report.identification._estimates import ESTIMATE_COLUMNS as ESTIMATE_COLUMNS
from kneejax.report.identification._estimates import estimates_table as estimates_table
from kneejax.report.identification._estimates import estimates_text as estimates_text
from kneejax.report.identification._estimates import fit_doubts as fit_doubts
from kneejax.report.identification._estimates import identified_table as identified_table
from kneejax.report.identification._estimates import undetermined_words as undetermined_words
from kneejax.report.identification._figures import profiles_figure as profiles_figure
from kneejax.report.identification._figures import spectrum_figure as spectrum_figure
from kneejax.report.identification._information import INFORMATION_COLUMNS as INFORMATION_COLUMNS
from kneejax.report.identification._information import information_notes as information_notes
from kneejax.report.identification._information import information_table as information_table
from kneejax.report.identification._information import information_text as information_text
from kneejax.report.identification._information import reason_words as reason_words
from kneejax.report.identification._information import slack_words as slack_words
from kneejax.report.identification._information import sloppy_words as sloppy_words
from kneejax.report.identification._information import stiff_words as stiff_words
