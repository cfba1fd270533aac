"""What controllers leave: runs, tuned laws, comparisons, the figures of the paper."""
