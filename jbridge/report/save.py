"""Saves results into a folder: for programs first, since that takes no time, then for people."""

from pathlib import Path

import numpy as np

from ..diagnosis.result import Diagnosis
from ..identification.result import Fit
from ..model.files import save_model
from ..recordings import save_csv
from .as_json import INPUT_FILE, fit_json, report_json
from .diagnosis.page import diagnosis_page
from .figures.gallery import OWN_NAME, Gallery, diagnosis_gallery, fit_gallery
from .files import PathLike, alone_in_folder, write_bytes, write_text
from .fit_page import fit_page

FIGURES = "figures"


@alone_in_folder
def save_report(folder: PathLike, diagnosis: Diagnosis) -> Path:
    """Writes report.json, model.toml, next_experiment.csv (if there is one), figures/*.png and report.html.

    Each file is replaced at once, so one that exists is whole whatever happens. What an earlier report left there and
    this one lacks is removed, since it would seem to belong to this one.

    Returns:
        The path of report.html.

    Raises:
        InputError: if a file cannot be written.
    """
    target = Path(folder)
    write_text(target / "report.json", report_json(diagnosis))
    save_model(target / "model.toml", diagnosis.model)
    experiment = diagnosis.next_experiment
    if experiment is not None:
        save_csv(target / INPUT_FILE, {name: np.asarray(column) for name, column in experiment.columns.items()})
    else:
        (target / INPUT_FILE).unlink(missing_ok=True)
    gallery = diagnosis_gallery(diagnosis)
    _save_figures(target / FIGURES, gallery)
    write_text(target / "report.html", diagnosis_page(diagnosis, gallery))
    return target / "report.html"


@alone_in_folder
def save_fit(folder: PathLike, fit: Fit) -> Path:
    """Writes fit.json, model.toml, figures/*.png and fit.html, as `save_report` does.

    Returns:
        The path of fit.html.

    Raises:
        InputError: if a file cannot be written.
    """
    target = Path(folder)
    write_text(target / "fit.json", fit_json(fit))
    save_model(target / "model.toml", fit.model)
    gallery = fit_gallery(fit)
    _save_figures(target / FIGURES, gallery)
    write_text(target / "fit.html", fit_page(fit, gallery))
    return target / "fit.html"


def _save_figures(folder: Path, gallery: Gallery) -> None:
    names = set()
    for picture in gallery.all():
        names.add(f"{picture.name}.png")
        write_bytes(folder / f"{picture.name}.png", picture.png)
    for old in folder.glob("*.png"):
        if old.name not in names and OWN_NAME.fullmatch(old.name):
            old.unlink(missing_ok=True)
