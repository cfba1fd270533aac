# %% [markdown]
# # Teach a lab course with it
#
# Students get recordings of a rig that has one property more than their model, and find out which. The teacher makes
# the rig: any effect of the catalogue, at any size, with the encoders' noise.

# %%
import tempfile
from pathlib import Path

import numpy as np

import jbridge

jbridge.set_up()
folder = Path(tempfile.mkdtemp())
LECTURE = """\
[bridge]
cart_mass = 5.5
load_mass = 0.143
cart_damping = 45.0
swing_damping = 0.0015
cart_gain = 16.0
known = ["cart_mass", "load_mass", "gravity"]
"""
CONCEALED = """
[[effect]]
kind = "quadratic_drag"
site = "cart"
coefficient = 25.0
"""
(folder / "lecture.toml").write_text(LECTURE)
(folder / "truth.toml").write_text(LECTURE + CONCEALED)
truth = jbridge.load_model(folder / "truth.toml")

# %% [markdown]
# **The teacher records**: sums of sines of the voltage, played on the true rig, read by encoders of 0.04 mm and 0.04
# degrees.


# %%
def record(name: str, seed: int) -> jbridge.Recording:
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, 0.01)
    rope = {"locked": {"l": 0.6}}
    volts = sum(a * np.sin(w * t) for a, w in zip(rng.uniform(1, 3, 3), rng.uniform(0.6, 4, 3), strict=True))
    rest = {"x": np.full(t.size, 0.7), "psi": np.zeros(t.size)}
    inputs = jbridge.Recording.from_arrays(t=t, u_x=volts, **rest, name=name, sidecar=rope, force=True)
    run = jbridge.simulate(truth, inputs, initial="first-row")
    x = run["x"] + 4e-5 * rng.standard_normal(t.size)
    psi = run["psi"] + 7e-4 * rng.standard_normal(t.size)
    return jbridge.Recording.from_arrays(t=t, u_x=volts, x=x, psi=psi, name=name, sidecar=rope)


train, proof = [record(f"day-{k}", k) for k in range(3)], [record("exam", 9)]

# %% [markdown]
# **The students fit** the model of the lecture, which has viscous friction alone, and look at what it leaves.

# %%
lecture = jbridge.load_model(folder / "lecture.toml")
fitted = jbridge.fit(lecture, train, proof)
fitted.plot()

# %% [markdown]
# **They argue**, before they ask: is it the cart or the swing? Does it grow with the speed? Does it differ by
# direction? Then they let the diagnosis answer.

# %%
found = jbridge.diagnose(lecture, train, proof)
print(found.statement)

# %% [markdown]
# **They check the answer against the truth**, which the teacher reveals.

# %%
for effect in found.effects:
    for key, estimate in effect.parameters.items():
        print(effect.kind, key, estimate.value, estimate.unit)
print(CONCEALED)

# %% [markdown]
# **Variations.** Smaller effects, until they drown in the noise; two at once; a law that the catalogue does not have,
# which must end as `unknown`; recordings that hardly move, in which nothing can be found, and the report says so.
