"""Which physics can a model file hold and a diagnosis name? The documentation's table, from the catalogue itself.

python experiments/catalogue.py --out docs/effects.md
"""

import argparse
import inspect
from pathlib import Path

from jbridge import CATALOGUE

TABLE = Path(__file__).parents[1] / "docs" / "effects.md"
HEAD = """\
# Effects

What a model file may hold in `[[effect]]` tables, and what a diagnosis can name. Written by
`python experiments/catalogue.py` from `jbridge/model/effects`; do not edit.

`q` and `v` are the coordinate and velocity of the site's axis: `x` for `cart`, `cart_drive` and `x_sensor`, `psi` for
`swing` and `psi_sensor`, `l` for `hoist`, `hoist_drive` and `l_sensor`; the `clock` is that of all time stamps. Units
are those at the first site; at the swing N becomes N m and m becomes rad. Parameters in brackets may be left out.
Vectors end in `[]`.

A drive composes in the order delay, saturation, dead zone, gain asymmetry and drift, drum radius, lag, back-EMF
and freewheeling, ripple, gain, force limit.
Beside a Coulomb friction of the same axis an added friction is written with its smallest level at 0, since levels add.

| kind | sites | parameters | law |
|---|---|---|---|
"""
FOOT = """
Besides these a diagnosis weighs `wrong_value`, whose site is the name of a known number: a mass, a damping or a gain
of the bridge.
"""
ALIKE = """
Some recordings cannot tell an effect from another one:

| effect | looks like | in | told apart by |
|---|---|---|---|
"""
UNITS = {
    "x": {"force": "N", "position": "m", "speed": "m/s"},
    "psi": {"force": "N m", "position": "rad", "speed": "rad/s"},
    "l": {"force": "N", "position": "m", "speed": "m/s"},
}
AXES = {"cart": "x", "swing": "psi", "hoist": "l", "x_sensor": "x", "psi_sensor": "psi", "l_sensor": "l"}


def parameters(effect: type) -> str:
    """Names with units, in the order of the file."""
    units = UNITS[AXES.get(effect.sites[0].removesuffix("_drive"), "x")]
    found = []
    for field in effect.__dataclass_fields__.values():
        told = field.metadata.get("parameter")
        if told:
            name = (told["key"] or field.name) + ("[]" if told["vector"] else "")
            text = f"`{name}` [{told['unit'].format(input='V', **units)}] {told['doc']}"
            found.append(f"({text})" if told["optional"] else text)
        elif "choices" in field.metadata:
            words = " or ".join(f'"{word}"' for word in field.metadata["choices"])
            found.append(f"(`{field.name}` {words})")
    return "; ".join(found)


def table() -> str:
    rows = []
    for kind, effect in CATALOGUE.items():
        law = inspect.getdoc(effect).split("\n\n")[0].replace("\n", " ")
        cells = (f"`{kind}`", ", ".join(effect.sites), parameters(effect), law)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    alike = [
        f"| `{kind}` at {other.own_site} | `{other.kind}` at {other.site} | {other.recordings} | {other.separated_by} |"
        for kind, effect in CATALOGUE.items()
        for other in effect.alike
    ]
    return HEAD + "\n".join(rows) + "\n" + FOOT + ALIKE + "\n".join(alike) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=TABLE, help="where the table goes (default: %(default)s)")
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(table(), encoding="utf-8")


if __name__ == "__main__":
    main()
