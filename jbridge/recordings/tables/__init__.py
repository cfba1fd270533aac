"""Files and variables as named columns of numbers, before anything is known about their meaning."""
