"""A posterior in text and figures."""

from kneejax.report.bayesian._posterior_figures import marginals_figure as marginals_figure
from kneejax.report.bayesian._posterior_figures import pairs_figure as pairs_figure
from kneejax.report.bayesian._posterior_figures import posterior_drawings as posterior_drawings
from kneejax.report.bayesian._posterior_figures import predictive_figure as predictive_figure
from kneejax.report.bayesian._posterior_text import POSTERIOR_COLUMNS as POSTERIOR_COLUMNS
from kneejax.report.bayesian._posterior_text import draws_table as draws_table
from kneejax.report.bayesian._posterior_text import posterior_doubts as posterior_doubts
from kneejax.report.bayesian._posterior_text import posterior_summary as posterior_summary
from kneejax.report.bayesian._posterior_text import posterior_table as posterior_table
from kneejax.report.bayesian._posterior_text import sampling_words as sampling_words
