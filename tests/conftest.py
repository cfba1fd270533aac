"""Settings of the run: double precision, no silent promotion, cached compilation, plots without a display."""

import os
from pathlib import Path

os.environ["MPLBACKEND"] = "Agg"  # for the commands that tests start, too

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

_caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
jax.config.update("jax_compilation_cache_dir", str(_caches / "jbridge" / "jax"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
