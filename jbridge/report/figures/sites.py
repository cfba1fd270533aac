"""Which place the recordings accuse."""

from collections.abc import Mapping

from matplotlib.figure import FigureBase

from ...model.names import site_name
from ..text.quantities import percent
from .style import MARK, NOISE, Picture, picture


def draw_evidence(name: str, sites: Mapping[str, float], chosen: str | None) -> Picture | None:
    """Each site's share of the criterion's decrease as bars, the largest on top; None where no site was weighed."""
    ranked = sorted(sites.items(), key=lambda entry: -entry[1])
    if not ranked:
        return None

    def draw(figure: FigureBase) -> None:
        panel = figure.subplots()
        places = range(len(ranked))[::-1]
        colours = [MARK if site == chosen else NOISE for site, _ in ranked]
        panel.barh(places, [100 * share for _, share in ranked], color=colours, height=0.62)
        for place, (_, share) in zip(places, ranked, strict=True):
            panel.text(100 * share + 1, place, percent(share), va="center", fontsize=10)
        panel.set_yticks(places, [site_name(site) for site, _ in ranked])
        panel.tick_params(axis="y", length=0)
        panel.grid(False, axis="y")
        panel.set_xlim(0, 108)
        panel.set_xlabel("share of the criterion's decrease [%]")

    return picture(
        name, "Where a missing force or signal would explain the recordings best", 0.8 + 0.34 * len(ranked), draw
    )
