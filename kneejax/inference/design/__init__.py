"""What to measure next."""

from kneejax.inference.design._candidates import Candidate as Candidate
from kneejax.inference.design._candidates import LoadCaseDerivatives as LoadCaseDerivatives
from kneejax.inference.design._candidates import load_case_derivatives as load_case_derivatives
from kneejax.inference.design._candidates import load_cases_of as load_cases_of
from kneejax.inference.design._candidates import usual_candidates as usual_candidates
from kneejax.inference.design._design import Design as Design
from kneejax.inference.design._design import check_tests as check_tests
from kneejax.inference.design._design import choose as choose
from kneejax.inference.design._design import criterion_of as criterion_of
from kneejax.inference.design._design import design_tests as design_tests
from kneejax.inference.design._design import standard_errors as standard_errors
from kneejax.inference.design._design import told_by as told_by
