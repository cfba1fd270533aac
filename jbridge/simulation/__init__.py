"""Where time passes: held inputs, rollouts, the closed loop, and what is kept of a run."""
