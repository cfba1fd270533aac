"""`fit.html`: the fitted numbers first, then how well they do."""

from ..identification.result import Fit
from .diagnosis.page import errors_table
from .figures.gallery import Gallery, fit_signals
from .text.html import bullets, element, page, paragraph, parameter_tables, section, show, show_all, tag
from .text.quantities import digits
from .text.rows import error_rows, parts
from .text.words import CHANNELS, capital, effect_name


def fit_page(fit: Fit, gallery: Gallery) -> str:
    """The page as HTML, with everything that it needs inside."""
    return page(
        "Fitted model - jbridge", [_header(fit), _parameters(fit, gallery), *_errors(fit, gallery), _footer(fit)]
    )


def fit_summary(fit: Fit) -> str:
    """The fitted numbers and how well they do as a piece of HTML, for notebooks."""
    errors = errors_table(None, (fit.holdout or fit.train).free_run, fit.noise)
    return element("div", "\n".join([_header(fit), _parameters(fit, Gallery()), errors, show(fit_signals(fit))]))


def fit_sentence(fit: Fit) -> str:
    """How well the fitted model does, in one sentence, on recordings it was not fitted to if there are any."""
    errors, which = (fit.holdout, "hold-out") if fit.holdout else (fit.train, "training")
    rows = error_rows(None, errors.free_run, fit.noise)
    said = ", ".join(f"{CHANNELS[row.channel]} to {row.after} ({row.after_ratio})" for row in rows)
    return f"The fitted model reproduces the {which} recordings: {said}."


def _header(fit: Fit) -> str:
    return element(
        "header",
        tag("p", "The model is fitted", "verdict") + tag("h1", fit_sentence(fit)) + bullets(fit.warnings, "warnings"),
    )


def _parameters(fit: Fit, gallery: Gallery) -> str:
    known = fit.model.known
    pieces = []
    for part in parts(fit):
        if part.kind is not None and part.site is not None:
            pieces.append(tag("h3", capital(effect_name(part.kind, part.site))))
        pieces.append(parameter_tables(part.parameters, part.kind, part.site, known))
        if part.kind is not None and part.site is not None:
            pieces.append(show((gallery.maps or {}).get((part.kind, part.site))))
    return section("The fitted numbers", *pieces)


def _errors(fit: Fit, gallery: Gallery) -> list[str]:
    pieces = []
    for errors, which in ((fit.holdout, "Hold-out"), (fit.train, "Training")):
        if errors is not None:
            pieces += [
                tag("h3", f"{which}, whole recordings"),
                errors_table(None, errors.free_run, fit.noise),
                tag("h3", f"{which}, windows of {fit.window:g} s"),
                errors_table(None, errors.window, fit.noise),
            ]
    explained = paragraph(
        "Errors are root mean squares of simulations that are given the inputs and the start alone. An error of 1 ×"
        " noise is as good as the sensors can show; if it is much more, ask jbridge diagnose what the model lacks.",
        "soft",
    )
    return [
        section("How well it fits", *pieces, explained),
        section("Recorded and simulated", show_all(gallery.signals)),
        section("What simulation leaves", show_all(gallery.residuals)),
        section("Notes on the recordings", bullets(fit.notes)),
    ]


def _footer(fit: Fit) -> str:
    return element(
        "footer", paragraph(f"The fit took {digits(fit.seconds)} s. The same numbers, in SI units: fit.json.")
    )
