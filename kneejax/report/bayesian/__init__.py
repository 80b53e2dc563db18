"""A posterior in text and figures."""

from kneejax.report.bayesian._posterior_figures import marginals_figure as marginals_figure
from kneejax.report.bayesian._posterior_figures import pairs_figure as pairs_figure
from kneejax.report.bayesian._posterior_figures import posterior_figures as posterior_figures
from kneejax.report.bayesian._posterior_figures import predictive_figure as predictive_figure
from kneejax.report.bayesian._posterior_text import POSTERIOR_COLUMNS as POSTERIOR_COLUMNS
from kneejax.report.bayesian._posterior_text import posterior_doubts as posterior_doubts
from kneejax.report.bayesian._posterior_text import posterior_rows as posterior_rows
from kneejax.report.bayesian._posterior_text import posterior_summary as posterior_summary
