"""What an earlier report left open, for a diagnosis that goes on from it."""

from pathlib import Path

from ..._files import read_json
from ...diagnosis.result import Former
from ...errors import InputError
from ..as_json import SCHEMA
from ..files import PathLike

_FIRST = "diagnose without --with first, into the same folder"


def load_former(folder: PathLike) -> Former:
    """What the report in a folder named, and what it could not tell from that.

    Raises:
        InputError: there is no report of a diagnosis, or it cannot be read.
    """
    path = Path(folder) / "report.json"
    try:
        report = read_json(path)
    except FileNotFoundError:
        raise InputError(f"{path}: no report to go on from; {_FIRST}") from None
    except (OSError, ValueError):
        raise InputError(f"{path}: not a report that can be read; {_FIRST}") from None
    if report.get("schema") != SCHEMA or not isinstance(report.get("effects"), list):
        raise InputError(f"{path}: not the report of a diagnosis; {_FIRST}")
    rows = []
    try:
        for effect in report["effects"]:
            for row in (effect, *effect["equivalents"]):
                chance = row["probability"]
                chance = None if chance is None else float(chance)
                rows.append({"kind": str(row["kind"]), "site": str(row["site"]), "probability": chance})
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path}: its effects are not as a diagnosis writes them; {_FIRST}") from None
    return Former(tuple(rows))
