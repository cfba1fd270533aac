"""Can any file crash a reader? Ten thousand damaged files of every kind that jbridge reads.

    python experiments/fuzz/fuzz.py --count 10000

Each is read, or refused with one line; nothing else may come of it: no traceback, no signal, no more than 1 GB and
10 s. What is neither is written to the folder of `--out`, with what was said, and the exit status is 1.
"""

import argparse
import collections
import sys
from pathlib import Path

from corpus import corpus
from mutate import mutant
from workers import outcomes


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="inputs (%(default)s)")
    parser.add_argument("--first", type=int, default=0, help="number of the first one (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="(%(default)s)")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"), help="what is neither read nor refused")
    arguments = parser.parse_args()
    cases = corpus()
    numbers = range(arguments.first, arguments.first + arguments.count)
    found: collections.Counter[tuple[str, str]] = collections.Counter()
    inputs = (mutant(cases, number, arguments.seed) for number in numbers)
    for number, outcome in zip(numbers, outcomes(inputs), strict=True):
        case = mutant(cases, number, arguments.seed)
        found[case.changed, outcome.kind] += 1
        if not outcome.sound:
            folder = arguments.out / f"{arguments.seed}-{number}"
            folder.mkdir(parents=True, exist_ok=True)
            for name, content in case.files.items():
                (folder / name).write_bytes(content)
            (folder / "outcome.txt").write_text(f"{outcome.kind}\n{outcome.text}\n")
            print(f"{folder}: {outcome.kind} {outcome.text.strip().splitlines()[-1][:160]}", flush=True)
    for (name, kind), count in sorted(found.items()):
        print(f"{name:16} {kind:10} {count}")
    return 0 if all(kind in ("read", "refused") for _, kind in found) else 1


if __name__ == "__main__":
    sys.exit(main())
