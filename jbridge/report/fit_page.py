"""`fit.html`: what stands where is the matter of `assets/fit.html`."""

from ..identification.result import Fit
from .figures.gallery import Gallery, fit_signals
from .text.html import page, piece
from .text.rows import error_rows, is_met, parts
from .text.words import CHANNELS


def fit_page(fit: Fit, gallery: Gallery) -> str:
    """The page as HTML, with everything that it needs inside."""
    sentence, maps = fit_sentence(fit), gallery.maps or {}
    return page("fit.html", fit=fit, sentence=sentence, parts=parts(fit), gallery=gallery, maps=maps)


def fit_summary(fit: Fit) -> str:
    """The fitted numbers and how well they do as a piece of HTML, for notebooks."""
    return piece("fit_summary.html", fit=fit, sentence=fit_sentence(fit), parts=parts(fit), picture=fit_signals(fit))


def fit_sentence(fit: Fit) -> str:
    """How well the fitted model does, in one sentence, on recordings it was not fitted to if there are any."""
    errors, which = (fit.holdout, "hold-out") if fit.holdout else (fit.train, "training")
    rows = error_rows(None, errors.free_run, fit.noise)
    said = ", ".join(f"{CHANNELS[row.channel]} by {row.after} ({row.after_ratio})" for row in rows)
    more = "" if is_met(fit) else " To find out what the model lacks, run jbridge diagnose."
    return f"In free runs the fitted model misses the {which} recordings' {said}.{more}"
