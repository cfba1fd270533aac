"""What a model lacks: is it adequate, where does it fail, which physics explains it, and does that hold on new data."""
