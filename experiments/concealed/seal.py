"""Seals the truths: once hashed, they are opened only by the rig that plays them and by the scorer.

A sealed file holds one case a line, compressed and in base64 so that nobody reads it by accident;
`seals.json` holds the SHA-256 of each case's truth with its salt. A truth that was changed after sealing is
refused. The diagnosis under test is given a model file and recordings, never a truth.

    python experiments/concealed/seal.py --half dev            seal (before any diagnosis)
    python experiments/concealed/seal.py --half dev --check    do they hold, and follow from the seed?
    python experiments/concealed/seal.py --half dev --open dev-07
"""

import argparse
import base64
import hashlib
import json
import zlib

from cases import HERE, MASTER, cases

SEALS = HERE / "seals.json"


def encode(truth: dict, salt: str) -> bytes:
    """What is hashed: sorted JSON with a salt, so that no guess can be tested against the hash."""
    return json.dumps({"salt": salt, "truth": truth}, sort_keys=True).encode()


def pack(payload: bytes) -> str:
    return base64.b64encode(zlib.compress(payload, 9)).decode()


def unpack(line: str) -> bytes:
    return zlib.decompress(base64.b64decode(line))


def seal(half: str) -> None:
    """Writes `sealed-HALF.txt` and the half's hashes."""
    lines, hashes = [], {}
    for name, truth in cases(half).items():
        salt = hashlib.sha256(f"{MASTER[half]} {name} salt".encode()).hexdigest()[:32]
        payload = encode(truth, salt)
        lines.append(f"{name} {pack(payload)}")
        hashes[name] = hashlib.sha256(payload).hexdigest()
    seals = json.loads(SEALS.read_text()) if SEALS.exists() else {}
    seals[half] = hashes
    (HERE / f"sealed-{half}.txt").write_text("\n".join(lines) + "\n")
    SEALS.write_text(json.dumps(seals, indent=1, sort_keys=True) + "\n")


def open_truths(half: str) -> dict[str, dict]:
    """The truths of a half by case id, each checked against its seal.

    Raises:
        ValueError: a truth is missing or was changed since it was sealed.
    """
    seals = json.loads(SEALS.read_text())[half]
    truths = {}
    for line in (HERE / f"sealed-{half}.txt").read_text().splitlines():
        name, sealed = line.split()
        payload = unpack(sealed)
        if hashlib.sha256(payload).hexdigest() != seals.get(name):
            raise ValueError(f"{name}: the truth does not match its seal; it was changed after sealing")
        truths[name] = json.loads(payload)["truth"]
    if set(truths) != set(seals):
        raise ValueError(f"sealed truths are missing: {', '.join(sorted(set(seals) - set(truths)))}")
    return truths


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--half", choices=sorted(MASTER), required=True)
    parser.add_argument("--check", action="store_true", help="check the seals and compare with the seed's truths")
    parser.add_argument("--open", metavar="CASE", help="print one truth")
    options = parser.parse_args()
    if options.open:
        print(json.dumps(open_truths(options.half)[options.open], indent=1))
    elif options.check:
        same = open_truths(options.half) == json.loads(json.dumps(cases(options.half)))
        print(f"seals hold; truths {'follow' if same else 'do NOT follow'} from the seed and sizes.json")
    else:
        seal(options.half)
        print(f"sealed {len(open_truths(options.half))} cases of {options.half}")


if __name__ == "__main__":
    main()
