"""What does the model of this rig lack? The diagnosis on recordings whose missing effect it is not told.

    python experiments/demo.py --out out/demo
    python experiments/demo.py --out out/demo --picture figures/demo.png     the README's picture, too

The recordings lie in experiments/demo_data: `train-*.csv` to find out, `holdout-*.csv` to prove it, and in
`model.toml` what the rig's owner knows. What was concealed is in `truth.txt`, in base64 so that nobody reads it by
accident, and `seal.txt` is the SHA-256 of its content: base64 -d experiments/demo_data/truth.txt
"""

import argparse
import shutil
import sys
from pathlib import Path

from jbridge import describe_diagnosis, diagnose, load_model, load_recordings, save_report, set_up

DATA = Path(__file__).parent / "demo_data"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--data", type=Path, default=DATA, help="folder with model.toml and recordings (default: %(default)s)"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/demo"), help="where the report goes (default: %(default)s)"
    )
    parser.add_argument("--picture", type=Path, help="where to save the figure of the hold-out besides")
    arguments = parser.parse_args()

    set_up()
    model = load_model(arguments.data / "model.toml")
    train = load_recordings(sorted(arguments.data.glob("**/train-*.csv")))
    holdout = load_recordings(sorted(arguments.data.glob("**/holdout-*.csv")))
    print(f"{len(train)} recordings to learn from, {len(holdout)} to prove it; one moment", file=sys.stderr)

    diagnosis = diagnose(model, train, holdout)
    save_report(arguments.out, diagnosis)
    if arguments.picture is not None:
        arguments.picture.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(next((arguments.out / "figures").glob("signals-holdout-*.png")), arguments.picture)
    print(describe_diagnosis(diagnosis, arguments.out), end="")


if __name__ == "__main__":
    main()
