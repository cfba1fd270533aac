"""The search for a structure: a linear screen proposes, moves change the model, one criterion decides."""
