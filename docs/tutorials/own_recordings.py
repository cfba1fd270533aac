# %% [markdown]
# # From recordings to named physics
#
# You have recordings of a rig and a model of it, and the two disagree. Here they are the demo's: a cart with a
# swinging load, recorded four times by another simulator that conceals one effect. Put your own files in their place.

# %%
from pathlib import Path

import jbridge

jbridge.set_up()
data = Path(jbridge.__file__).parent / "demo_data"
model = jbridge.load_model(data / "model.toml")
train = jbridge.load_recordings(sorted(data.glob("train-*.csv")))
proof = jbridge.load_recordings([data / "holdout-1.csv"])

# %% [markdown]
# **What was recorded?** A recording says what it was read as. Here the encoders' steps are known from the sidecar,
# and the rope is locked.

# %%
for recording in train:
    print(recording.name, f"{recording.duration:.1f} s at {1 / recording.period:.0f} Hz", *recording.notes, sep="\n  ")

# %% [markdown]
# **Does the model explain it?** A fit changes all numbers that are not `known`. What it leaves is far from the
# encoders' noise: on the hold-out the simulated cart ends elsewhere.

# %%
fitted = jbridge.fit(model, train, proof)
fitted

# %%
fitted.plot()

# %% [markdown]
# **What is missing?** A diagnosis looks for the effect that makes the model agree. The hold-out takes no part in it
# until the structure is fixed.

# %%
found = jbridge.diagnose(model, train, proof)
print(found.statement)
for effect in found.effects:
    print(effect.status, effect.kind, effect.site)

# %%
found.plot()

# %% [markdown]
# The friction of this rail differs by place and by direction: what the virtual rig concealed. `found.model` has it,
# with every number and its interval; `found.save("report")` writes the report, the model and the figures.
#
# **Questions to ask.** Which error would a model without any friction leave? What if only two of the recordings are
# used, or only the first five seconds of each? Which recording would you make next, and why?
