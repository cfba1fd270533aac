"""Results of controllers: runs, tuned laws, comparisons."""
