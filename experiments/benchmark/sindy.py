"""The first entrant: sparse regression on smoothed accelerations, by pysindy, with the library of the rivals.

python experiments/benchmark/sindy.py CASE OUT
"""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "concealed"))

from jbridge import load_model, load_recordings
from rivals import diagnose


def main() -> None:
    case, out = (Path(word) for word in sys.argv[1:3])
    recordings = load_recordings(sorted((case / "recordings").glob("train-*.csv")))
    report = diagnose("sindy", load_model(case / "model.toml"), recordings)
    (out / "report.json").write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
