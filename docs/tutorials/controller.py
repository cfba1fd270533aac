# %% [markdown]
# # Tune a controller and flash it
#
# A controller moves the load of a bridge to a place without leaving it swinging. Here a PID controller is tuned on a
# model by gradients through simulated moves, and written as a C header for a microcontroller.

# %%
import tempfile
from pathlib import Path

import jbridge

jbridge.set_up()
here = next(path for path in (Path.cwd(), *Path.cwd().parents) if (path / "experiments").is_dir())
model = jbridge.load_model(here / "experiments" / "paper" / "guess.toml")

# %% [markdown]
# The law begins with usual gains; dead zones and dry friction of the model are compensated.

# %%
law = jbridge.Pid(compensation=jbridge.compensation_for(model.plant))
given = jbridge.Controller(law, 0.02)
path = jbridge.paper_path(given.period)
before = jbridge.track(model, given, path)
before

# %% [markdown]
# Bridges scatter about the model, so that the controller is tuned for the rig and not for one simulation of it. Eight
# bridges and 30 steps keep this page quick; `jbridge tune` takes 64 and 200.

# %%
tuning = jbridge.tune(model, given, plants=8, steps=30, starts=1)
print(jbridge.describe_tuning(tuning))

# %%
after = jbridge.track(model, tuning.controller, path)
for name, run in (("before", before), ("after", after)):
    print(name, [move.settling_time for move in run.moves])

# %% [markdown]
# **Flash it.** The header has no dependency and no allocation: call `..._step` in the sampling interrupt.

# %%
folder = Path(tempfile.mkdtemp())
jbridge.save_controller(folder / "pid.toml", tuning.controller)
header = jbridge.save_export(folder, folder / "pid.toml", "c")
print(Path(header).read_text()[:900])

# %% [markdown]
# **Questions to ask.** How does the move end if the load weighs twice as much? If the controller runs at 10 Hz? Which
# gain does the tuning change most, and what would have happened had you changed it by hand?
